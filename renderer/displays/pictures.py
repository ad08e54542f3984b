"""Selects the display that a picture is for, and makes its picture of a light field."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ciir.bit_depth import count_unused_camera_bits, raise_levels
from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.displays.depth_budget import describe_directions, describe_light_field, describe_native
from ciir.renderer.displays.devices import Quilt, resolve_quilt
from ciir.renderer.displays.integral import IntegralDisplay, parse_display
from ciir.renderer.displays.lenticular import Calibration, interlace, parse_calibration
from ciir.renderer.displays.light_fields import (
    find_padded_size,
    find_reduction,
    find_row,
    make_quilt,
    note_borders,
    order_as_cameras,
    take_row,
)
from ciir.renderer.displays.panel import Conversion, resample_panel
from ciir.renderer.displays.prints import PRINT, make_calibration
from ciir.renderer.displays.quilt import parse_grid
from ciir.renderer.levels import note_raising
from ciir.renderer.limits import DEFAULT_LIMITS

if TYPE_CHECKING:
    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.displays.quilt import QuiltLayout, QuiltName
    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.writers.options import FormatOptions

Kind = Literal["quilt", "lenticular", "panel"]
Target = Quilt | Calibration | IntegralDisplay
USES: dict[Kind, tuple[str, ...]] = {
    "quilt": ("device", "quilt", "aspect", "disparity"),
    "lenticular": ("calibration", *PRINT, "disparity"),
    "panel": ("display", "conversion", "disparity"),
}
"""Kinds of pictures for displays, and the names of the `FormatOptions` that each uses."""
NATIVE_VIEWS = 48
"""Number of views that a light field with fewer is given for a native picture."""
BLACK = "alpha: the views are placed on a black background"
"""The note on views that are not opaque."""


@dataclass(frozen=True)
class DisplayPicture:
    """A picture for a display."""

    pixels: Pixels
    """`(height, width, 1 or 3)`."""
    notes: tuple[str, ...]
    layout: QuiltLayout | None = None
    """The layout of a quilt."""
    ppi: float | None = None
    """Pixels per inch, if known; a quilt's are not."""


def find_kind(options: FormatOptions) -> Kind:
    """Returns the kind of picture that the options are for."""
    return "panel" if options.display else "lenticular" if options.calibration or describes_print(options) else "quilt"


def describes_print(options: FormatOptions) -> bool:
    """Returns whether any option that describes a print is given."""
    return any(getattr(options, name) for name in PRINT)


def find_target(
    kind: Kind,
    options: FormatOptions,
    *,
    named: QuiltName | None = None,
    max_pixels: int = DEFAULT_LIMITS.pixels,
) -> Target:
    """Returns the display that `options` describe. `named`: the layout in the picture's name, which only a quilt has.

    Raises `InvalidOption` if the description is missing or wrong, and the errors of `make_calibration`,
    `parse_calibration` and `parse_display`.
    """
    if named is not None and kind != "quilt":
        quilt = f"the output's name says {named.suffix[1:]}, so it would be read as a quilt"
        raise InvalidOption(f"{quilt}; give the {kind} picture another name")
    if kind == "quilt":
        grid = parse_grid(options.quilt) if options.quilt else None
        return resolve_quilt(named=named, device=options.device or None, grid=grid, aspect=options.aspect)
    if kind == "lenticular" and describes_print(options):
        if options.calibration:
            raise InvalidOption("print, calibration: both describe the display; leave one of them out")
        return make_calibration(
            options.print,
            options.lpi,
            options.dpi,
            view_distance=options.view_distance,
            view_angle=options.view_angle,
            max_pixels=max_pixels,
        )
    if kind == "lenticular":
        if not options.calibration:
            needed = "give the JSON file that a display stores, or the size of a print, such as print 6x4in"
            raise InvalidOption(f"calibration: a lenticular picture needs it; {needed}")
        return parse_calibration(options.calibration.encode(), name="calibration", max_pixels=max_pixels)
    if options.conversion not in get_args(Conversion):
        raise InvalidOption(
            f"conversion: {options.conversion[:40]!r} is not known; give {' or '.join(get_args(Conversion))}"
        )
    if not options.display:
        raise InvalidOption("display: a panel's picture needs it; give a TOML file as in docs/displays.md")
    return parse_display(options.display.encode(), name="display", max_pixels=max_pixels)


def find_size(
    target: Target,
    views: tuple[int, int] | None = None,
    own_aspect: float = 1.0,
    max_pixels: int = DEFAULT_LIMITS.pixels,
) -> tuple[int, int]:
    """Returns the height and width of the picture for `target`.

    `views`: height and width of a light field's views, which are shown with `own_aspect`; None for a mesh's.
    `max_pixels`: as in `show_light_field`, whose `TooLarge` it also raises.
    """
    if not isinstance(target, Quilt):
        return target.height, target.width
    height, width = target.tile
    if views is not None:
        stretch = 1.0 if target.keeps_aspect else target.layout.aspect / own_aspect
        factor = find_reduction(views, target.layout.count, max_pixels, stretch)
        height, width = find_padded_size((views[0] // factor, views[1] // factor), stretch)
    return height * target.layout.rows, width * target.layout.cols


def show_light_field(
    light_field: LightField,
    target: Target,
    options: FormatOptions,
    *,
    max_pixels: int = DEFAULT_LIMITS.pixels,
    progress: Progress = ignore_progress,
) -> DisplayPicture:
    """Returns the picture of a light field for `target`, with notes.

    `max_pixels`: most pixels of a quilt, whose views are made smaller if they exceed it. Levels of a camera with fewer
    than 16 bits are raised (`ciir.bit_depth`) by the bits that no shown view uses, because displays show the whole
    range. Raises `TooLarge` if they can't be made small enough.
    """
    if not isinstance(target, IntegralDisplay):
        shown = find_row(light_field.views.shape[0], light_field.depth_sense)
        light_field = light_field[shown : shown + 1]
    unused = count_unused_camera_bits(light_field.views)
    if unused:
        light_field = replace(light_field, views=raise_levels(light_field.views, unused))
    height, width = light_field.views.shape[2:4]
    pixel_aspect, disparity = light_field.pixel_aspect, options.disparity or 0.0
    own = round(width / height * pixel_aspect, 12)  # gives a quilt the aspect that was read, to the last digit
    first_notes = *note_raising("display", unused), *((BLACK,) if light_field.is_transparent() else ())
    if isinstance(target, Quilt):
        quilt, layout, notes = make_quilt(
            light_field,
            target.layout,
            own_aspect=own,
            keeps_aspect=target.keeps_aspect,
            disparity=disparity,
            max_pixels=max_pixels,
        )
        return DisplayPicture(quilt, (*first_notes, *notes), layout)
    cameras = order_as_cameras(light_field)
    if isinstance(target, IntegralDisplay):
        beyond = np.zeros(target.height)
        panel = resample_panel(
            cameras,
            target,
            conversion=options.conversion,
            disparity=disparity,
            pixel_aspect=pixel_aspect,
            beyond=beyond,
            progress=progress,
        )
        notes = describe_light_field(cameras, target, disparity, pixel_aspect)
        notes += describe_directions(float(beyond.mean()), cameras.shape[:2], target)
        return DisplayPicture(panel, (*first_notes, *notes), ppi=target.ppi)
    count = max(NATIVE_VIEWS, cameras.shape[1])
    row, notes = take_row(cameras, count, disparity=disparity)
    notes += describe_native(cameras, target, disparity, pixel_aspect)
    notes += note_borders((height, width), own, target.aspect)
    native = interlace(row, target, own_aspect=own, progress=progress)
    return DisplayPicture(native, (*first_notes, *notes), ppi=target.ppi)
