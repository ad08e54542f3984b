"""Looking Glass displays, described by the quilts they take, and the selection of the quilt to make.

Sizes: https://lfdocs.lookingglassfactory.com/keyconcepts/quilts, and pylightio (AliceLG), `lightfields.py`; a 16 inch
display in landscape reports 8x6 views in 7680x4320 pixels and a cone of 50 degrees, not the 7x7 of that page.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ciir.errors import InvalidOption
from ciir.renderer.displays.quilt import QuiltLayout, QuiltName


@dataclass(frozen=True)
class Device:
    """A display: its quilt's layout and size in pixels, and the angle between its outermost cameras."""

    layout: QuiltLayout
    width: int
    height: int
    cone: float = 40.0
    """Degrees."""

    @property
    def tile(self) -> tuple[int, int]:
        """Height and width of a view in the quilt, in pixels."""
        return self.height // self.layout.rows, self.width // self.layout.cols


LANDSCAPE, PORTRAIT = 16 / 9, 9 / 16
DEFAULT = "portrait"
DEVICES = {
    "portrait": Device(QuiltLayout(8, 6, 0.75), 3360, 3360),
    "go": Device(QuiltLayout(11, 6, PORTRAIT), 4092, 4092),
    "16-landscape": Device(QuiltLayout(8, 6, LANDSCAPE), 7680, 4320, 50.0),
    "16-portrait": Device(QuiltLayout(11, 6, PORTRAIT), 5995, 6000),
    "32-landscape": Device(QuiltLayout(7, 7, LANDSCAPE), 8190, 8190),
    "32-portrait": Device(QuiltLayout(11, 6, PORTRAIT), 8184, 8184),
    "65": Device(QuiltLayout(8, 9, LANDSCAPE), 8192, 8190),
    "8.9": Device(QuiltLayout(5, 9, 1.6), 4095, 4095),
}
"""The devices by name."""


def find_device(name: str) -> Device:
    """Returns the device called `name`, in any case. Raises `InvalidOption` for an unknown one."""
    found = DEVICES.get(name.lower())
    if found is None:
        raise InvalidOption(
            f"device: {name[:40]!r} is not known; give {', '.join(DEVICES)}, or a layout such as quilt 8x6 aspect 0.75"
        )
    return found


@dataclass(frozen=True)
class Quilt:
    """A quilt to make."""

    layout: QuiltLayout
    tile: tuple[int, int]
    """Height and width of a mesh's views, in pixels; a light field's views keep their own size."""
    cone: float
    """Degrees between the outermost cameras."""
    keeps_aspect: bool = False
    """Whether a light field's views keep their own aspect, whatever the layout's is."""
    is_default: bool = False
    """Whether neither an option nor a name selected it."""
    notes: tuple[str, ...] = ()


def resolve_quilt(
    *,
    named: QuiltName | None = None,
    device: str | None = None,
    grid: tuple[int, int] | None = None,
    aspect: float | None = None,
) -> Quilt:
    """Returns the quilt of `device`, with `grid` (columns, rows) and `aspect` in place of the device's.

    `named`: the layout in the output's name, which stands in for a device. If none of them is given, it is the quilt of
    `DEFAULT`, which `match_views` may replace. Without a device or an aspect, a light field's views keep their own
    aspect. Raises `InvalidOption` for an unknown device, for a number out of range, and if `named` contradicts the
    others.
    """
    if device is None and named is None and grid is None and aspect is None:
        return _make_default(DEFAULT)
    shown = _find_by_name(named) if device is None else find_device(device)
    layout = shown.layout if device is not None or named is None else named.complete(shown.layout.aspect)
    if grid is not None:
        layout = replace(layout, cols=grid[0], rows=grid[1])
    if aspect is not None:
        layout = replace(layout, aspect=aspect)
    keeps_aspect = device is None and aspect is None and (named is None or named.aspect is None)
    if named is not None and named.complete(layout.aspect).suffix != layout.suffix:
        raise InvalidOption(
            f"the output's name says {named.suffix[1:]} and the options say {layout.suffix[1:]}; change one of them"
        )
    notes: tuple[str, ...] = ()
    if named is not None and keeps_aspect:
        notes = (f"quilt: its name has no aspect; views of a mesh get {layout.aspect:.4g}, others keep their own",)
    return Quilt(
        layout,
        shown.tile if layout == shown.layout else _fit_tile(shown, layout),
        shown.cone,
        keeps_aspect=keeps_aspect,
        notes=notes,
    )


def match_views(quilt: Quilt, count: int, aspect: float) -> Quilt:
    """Returns the quilt for a light field with `count` views in a row, whose width / height is `aspect`.

    It is `quilt`, or if that is the default and some devices show `count` views, the quilt of the one of them whose
    aspect is nearest: a quilt that is read keeps its columns and rows.
    """
    names = [name for name, device in DEVICES.items() if device.layout.count == count]
    if not quilt.is_default or not names:
        return quilt
    nearest = min(names, key=lambda name: abs(math.log(DEVICES[name].layout.aspect / aspect)))
    return _make_default(nearest, f", which shows {count} views, as many as a row of the light field has")


def find_aspect(grid: tuple[int, int], tile: tuple[int, int]) -> float | None:
    """Returns the aspect of the views in a device's quilt of `grid` views (rows, columns) of `tile` pixels, or None if
    no device has such quilts.
    """
    for device in DEVICES.values():
        if (device.layout.rows, device.layout.cols) == grid and device.tile == tile:
            return device.layout.aspect
    return None


def find_layout(size: tuple[int, int]) -> QuiltLayout | None:
    """Returns the layout of the first device whose quilts have `size` (height, width), or None."""
    return next((device.layout for device in DEVICES.values() if (device.height, device.width) == size), None)


def _make_default(name: str, reason: str = "") -> Quilt:
    """Returns the quilt of the device `name`, which no option selects, with a note that gives the `reason`."""
    device = DEVICES[name]
    note = f"quilt: made for the device {name}{reason}; the option device selects another: {', '.join(DEVICES)}"
    return Quilt(device.layout, device.tile, device.cone, keeps_aspect=True, is_default=True, notes=(note,))


def _find_by_name(named: QuiltName | None) -> Device:
    """Returns the first device whose quilts have the layout in this name, or else the default one."""
    for device in DEVICES.values():
        if named is not None and named.complete(device.layout.aspect).suffix == device.layout.suffix:
            return device
    return DEVICES[DEFAULT]


def _fit_tile(device: Device, layout: QuiltLayout) -> tuple[int, int]:
    """Returns the height and width of views with square pixels in a quilt that is no larger than the device's."""
    height = min(device.height // layout.rows, int(device.width // layout.cols / layout.aspect))
    return max(1, height), max(1, round(height * layout.aspect))
