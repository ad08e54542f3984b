"""Native pictures of lenticular displays: which view each subpixel shows, according to the display's calibration.

With x and y from 0 to 1, x to the right and y upwards, subpixel i (0 to 2 from the left) shows the view at

    place = fraction((x + i * subp + y * tilt) * pitch - center)
    pitch = pitch.value * screenW / DPI * cos(atan(1 / slope))   lenses across the screen
    tilt  = screenH / (screenW * slope), negative with flipImageX
    subp  = 1 / (3 * screenW)

and 1 - place with invView, as in Looking Glass' own shaders (HoloPlayCore, `HoloPlayShaders.h`). Place 0 is the
leftmost camera, 1 the rightmost.

A print has its own entry viewDistance, D inches. Its viewer sees the print's strips smaller than the lenses before
them, so pitch.value becomes LPI D / (D + gap), gap = (1 / LPI) / 2 / tan(viewCone / 2), with the middle kept in phase.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.backends.progress import ignore_progress, run_parts
from ciir.renderer.displays.integral import DEEP, Stripes
from ciir.renderer.displays.interpolation import weigh_neighbours
from ciir.renderer.displays.light_fields import find_padded_size
from ciir.renderer.displays.screen import FIELD_OF_VIEW
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.readers.pictures import Pixels


KEYS = (
    *("screenW", "screenH", "DPI", "pitch", "slope", "center", "viewCone", "invView"),
    *("flipImageX", "flipImageY", "flipSubp", "CellPatternMode", "subpixels", "viewDistance"),
)
"""Entries that are read; the others are ignored, such as a display's serial number."""
PATTERN = "the display's subpixels form a pattern: they are treated as stripes of red, green and blue"
INVERTED = "calibration: invView is 0: lenses on a print then show depth inverted; give invView 1 for a print"
SEEN = "calibration: seen from"
"""The first words of the note on the viewing distance."""
CHECK = "check pitch, the lenses per inch, and DPI"
UPRIGHT = 10_000
"""The slope that stands for upright lenses, and the largest one."""
MOST_SIDE = 100_000
"""Most pixels along a side."""
UNTESTED = (
    "calibration: pitch counts as the result of a pitch test; if it is the lens sheet's, give viewDistance in inches"
)


@dataclass(frozen=True)
class Calibration:
    """A display's calibration, in the units of the formula above."""

    width: int
    height: int
    pitch: float
    tilt: float
    center: float
    ppi: float
    """DPI: pixels per inch."""
    is_inverted: bool = False
    """invView: the views run from right to left."""
    flips: tuple[bool, bool] = (False, False)
    """flipImageX and flipImageY: whether the content is mirrored along x, and along y."""
    stripes: Stripes = "rgb"
    """subpixels, or else flipSubp: the colours of a pixel's thirds from the left; none: they lie at the same place."""
    cone: float = 40.0
    """viewCone: degrees between the outermost views."""
    field_of_view: float = FIELD_OF_VIEW
    """Degrees from the lower to the upper edge as the viewer at viewDistance sees them."""
    notes: tuple[str, ...] = ()

    @property
    def directions(self) -> float:
        """Number of view places under a lens."""
        return (1 if self.stripes == "none" else 3) * self.width / self.pitch

    @property
    def aspect(self) -> float:
        """Width / height."""
        return self.width / self.height

    @property
    def sharp(self) -> float:
        """Depth in front of and behind the screen, in its heights, up to which neighbouring directions are closer
        together than the lenses, as in `IntegralDisplay.sharp`."""
        return self.aspect / self.pitch * self.directions / (2 * math.tan(math.radians(self.cone) / 2))

    def content_positions(self, row: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns x and y, 0 to 1, in the views for the pixels of `row`, counted from the top: `(width,)` each."""
        x, y = self._positions(row)
        return (1 - x if self.flips[0] else x), np.full(self.width, 1 - y if self.flips[1] else y)

    def view_places(self, row: int) -> NDArray[np.float64]:
        """Returns the place of the view, 0 (leftmost camera) to 1, that a pixel's red, green and blue show:
        `(width, 3)`.
        """
        x, y = self._positions(row)
        subpixel = np.array({"rgb": (0, 1, 2), "bgr": (2, 1, 0), "none": (0, 0, 0)}[self.stripes])
        places = (x[:, None] + subpixel / (3 * self.width) + y * self.tilt) * self.pitch - self.center
        places -= np.floor(places)
        return 1 - places if self.is_inverted else places

    def _positions(self, row: int) -> tuple[NDArray[np.float64], float]:
        return (np.arange(self.width) + 0.5) / self.width, 1 - (row + 0.5) / self.height


def parse_calibration(
    data: bytes, *, name: str, remedy: str = CHECK, max_pixels: int = DEFAULT_LIMITS.pixels
) -> Calibration:
    """Returns the calibration in a JSON file, `{"pitch": {"value": 49.9}, ...}` as displays store it, or with plain
    numbers.

    It may also be the entry `calibration` of an object, or a reply of Looking Glass Bridge about one display. Displays
    don't store two of the entries: `"subpixels"` is `"rgb"`, `"bgr"` or, for prints, `"none"`, and replaces `flipSubp`;
    `"viewDistance"` is the distance of a print's viewer in inches, for which `pitch`, the lens sheet's, is adapted.

    `remedy`: the remedy for lenses that don't fit the pixels.

    A note advises prints against `invView` 0. Raises `Unreadable` if a number is missing or out of range, if the case
    of a key is wrong, if lenses cover fewer than 2 places for views or are wider than the screen, and `TooLarge` over
    `max_pixels`.
    """
    found = _load(data, name)
    width, height, dpi = (_read(found, key, name, (1, MOST_SIDE)) for key in ("screenW", "screenH", "DPI"))
    slope = _read_slope(found, name)
    pitch = _read(found, "pitch", name, (1e-3, 1e4))
    if width * height > max_pixels:
        raise TooLarge(
            f"{name}: a screen of {width:.0f}x{height:.0f} pixels; at most {max_pixels:,} are made", "pixels"
        )
    mirrored = _is_set(found, "flipImageX", name)
    stripes = _read_stripes(found, name)
    is_inverted = _is_set(found, "invView", name)
    cone = _read(found, "viewCone", name, (1, 120), 40.0)
    lenses = pitch * width / dpi * float(np.cos(np.arctan(1 / slope)))
    tilt = height / (width * slope) * (-1 if mirrored else 1)
    is_pattern = _read(found, "CellPatternMode", name, (0, 100), 0.0) > 0
    notes = [*((PATTERN,) if is_pattern else ()), *((INVERTED,) if stripes == "none" and not is_inverted else ())]
    center, seen, field_of_view = _read(found, "center", name, (-1e4, 1e4)), 1.0, FIELD_OF_VIEW
    if "viewDistance" in found:
        distance = _read(found, "viewDistance", name, (0.1, 1e5))
        gap = 1 / pitch / 2 / math.tan(math.radians(cone) / 2)
        seen = distance / (distance + gap)
        field_of_view = 2 * math.degrees(math.atan(height / dpi / 2 / distance))
        notes.append(f"{SEEN} {distance:g} inches, the pitch of {pitch:g} becomes {pitch * seen:.6g}")
    elif stripes == "none":
        notes.append(UNTESTED)
    calibration = Calibration(
        width=int(width),
        height=int(height),
        pitch=lenses * seen,
        tilt=tilt,
        center=center - (1 + tilt) / 2 * lenses * (1 - seen),
        ppi=dpi,
        is_inverted=is_inverted,
        flips=(mirrored, _is_set(found, "flipImageY", name)),
        stripes=stripes,
        cone=cone,
        field_of_view=field_of_view,
    )
    _check_lenses(calibration, name, remedy)
    if calibration.sharp > DEEP:
        deep = f"depth: detail would be sharp up to {calibration.sharp:.2g} heights of the screen from it"
        notes.append(f"{deep}; {remedy}")
    return replace(calibration, notes=tuple(notes))


def _load(data: bytes, name: str) -> dict[str, Any]:
    """Returns the entries of a calibration, whose keys have the right case."""
    try:
        found = _unwrap(json.loads(data))
    except (ValueError, RecursionError) as error:
        remedy = "give the calibration that the display stores (visual.json)"
        if b"[panel]" in data:
            remedy = "this describes a panel under lenses; give it as the option display"
        raise Unreadable(f"{name}: not JSON; {remedy}") from error
    if not isinstance(found, dict) or not any(key in found for key in KEYS):
        raise Unreadable(
            f"{name}: no calibration; give the JSON that the display stores (visual.json), the object that holds "
            "pitch, slope, center, ..."
        )
    for key in KEYS:
        wrong = next((other for other in found if other != key and other.lower() == key.lower()), None)
        if wrong is not None:
            raise Unreadable(f"{name}: {wrong} is not known; write {key}")
    return found


def _unwrap(found: Any) -> Any:
    """Returns the calibration in an object around it. Raises `ValueError` for a text in it that isn't JSON."""
    for key in ("devices", "calibration", "value"):
        inner = found.get(key) if isinstance(found, dict) else None
        if isinstance(inner, list) and len(inner) == 1:
            inner = inner[0]
        if isinstance(inner, str):
            inner = json.loads(inner)
        if isinstance(inner, dict):
            found = inner
    return found


def _read(found: dict[str, Any], key: str, name: str, span: tuple[float, float], default: float | None = None) -> float:
    value = found.get(key, default)
    value = value.get("value") if isinstance(value, dict) else value
    if isinstance(value, int | float) and span[0] <= value <= span[1]:
        return float(value)
    found_text = clean_text(str(value))[:40]
    what = "missing" if value is None else f"the text {found_text!r}" if isinstance(value, str) else found_text
    raise Unreadable(
        f"{name}: {key} is {what}; give a number from {span[0]:g} to {span[1]:g}, as the display stores it"
    )


def _is_set(found: dict[str, Any], key: str, name: str) -> bool:
    return _read(found, key, name, (0, 1), 0.0) > 0.5


def _read_slope(found: dict[str, Any], name: str) -> float:
    slope = _read(found, "slope", name, (-UPRIGHT, UPRIGHT))
    if not slope:
        raise Unreadable(f"{name}: slope is 0; give the slant of the lenses, or {UPRIGHT} for upright ones")
    return math.inf if abs(slope) == UPRIGHT else slope


def _read_stripes(found: dict[str, Any], name: str) -> Stripes:
    stripes: Stripes = found.get("subpixels", "bgr" if _is_set(found, "flipSubp", name) else "rgb")
    if stripes not in get_args(Stripes):
        given = clean_text(str(stripes))[:40]
        raise Unreadable(f"{name}: subpixels is {given!r}; give {' or '.join(map(repr, get_args(Stripes)))}")
    return stripes


def _check_lenses(calibration: Calibration, name: str, remedy: str) -> None:
    """Raises `Unreadable` for lenses that are wider than the screen or cover too few pixels."""
    if calibration.pitch < 1:
        raise Unreadable(
            f"{name}: lenses across the screen: {calibration.pitch:.3g}, and at least 1 is needed; {remedy}"
        )
    if calibration.directions < 2:
        places = "pixels" if calibration.stripes == "none" else "subpixels"
        raise Unreadable(
            f"{name}: {places} under a lens: {calibration.directions:.4g}, and at least 2 are needed; {remedy}"
        )


def interlace(
    views: Pixels,
    calibration: Calibration,
    *,
    own_aspect: float | None = None,
    progress: Progress = ignore_progress,
) -> Pixels:
    """Returns the native picture `(height, width, 3)` of views `(n, h, w, c)`, grey or RGB, from the leftmost on.

    Each subpixel is sampled bilinearly in the two views around its place, and the two are blended: the place is a
    direction between two cameras, and the blend is the light field there as far as views and pixels show it. The
    nearest view would be up to half a step of the cameras off, which shows as steps at slanted edges. Views are assumed
    to cover `calibration.cone`, and the whole screen but black borders if they are shown with the width / height
    `own_aspect`.
    """
    count, height, width, channels = views.shape
    high, wide = find_padded_size((height, width), calibration.aspect / (own_aspect or calibration.aspect))
    above, before = (high - height) // 2, (wide - width) // 2  # pixels of the borders, which take no memory here
    native = np.empty((calibration.height, calibration.width, 3), views.dtype)
    channel = np.arange(3) if channels >= 3 else np.zeros(3, np.intp)

    def make(row: int) -> None:
        x, y = calibration.content_positions(row)
        place = calibration.view_places(row) * (count - 1)  # (screen width, 3)
        # A row of the screen is at one height of the views. The outermost columns are black.
        lines = np.zeros((count, width + 2, channels), np.float32)
        for top, of_row in weigh_neighbours((1 - y[:1]) * high - 0.5, high):
            if 0 <= top[0] - above < height:
                lines[:, 1:-1] += views[:, top[0] - above] * np.float32(of_row[0])
        total = np.zeros(place.shape, np.float32)
        columns = [
            (np.clip(left - before + 1, 0, width + 1), of_column)
            for left, of_column in weigh_neighbours(x[:, None] * wide - 0.5, wide)
        ]
        for view, of_view in weigh_neighbours(place, count):
            for column, of_column in columns:
                total += (of_view * of_column) * lines.take((view * (width + 2) + column) * channels + channel)
        native[row] = np.rint(total)

    run_parts(make, calibration.height, progress)
    return native
