"""Options that say how to read an input: its lens array, and the order of its views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ciir.renderer.lens_array import MAX_PIXELS
from ciir.renderer.readers.layout import Arrangement, OrderCheck
from ciir.renderer.views import DepthSense, Flip, Pickup
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import make_integer, make_name, make_number, make_switch

Switch = Literal["yes", "no"]

READING = {
    "lenses": Option(
        "RxC",
        "rows x columns of lenses (default for a mesh: 100x100; an EIA needs this or --pixels)",
        values.PAIR,
        "50x50",
    ),
    "pixels": Option(
        "KvxKu",
        "rows x columns of pixels under each lens (default for a mesh: 15x15)",
        values.make_pair(MAX_PIXELS),
        "9x9",
    ),
    "pitch": Option(
        "LENGTH", "distance between lenses in scene units (default for a mesh: 1)", make_number(1e-9, 1e9), "0.5"
    ),
    "delta": Option(
        "TANGENT",
        "pixel size / gap (default for a mesh: 0.4 / the larger of the two numbers in --pixels)",
        make_number(1e-9, 1e9),
        "0.02",
    ),
    "parallax": Option(
        "DEGREES",
        "the whole viewing angle, instead of --delta (default for a mesh: 22.6)",
        make_number(0.01, 170, "degrees such as 30"),
        "30",
    ),
    "pickup": Option(
        "NAME",
        "virtual: elemental images are upright; optical: turned by 180 degrees (default: as stated in a PNG that ciir "
        "wrote, else virtual)",
        make_name(get_args(Pickup)),
        "optical",
    ),
    "frame": Option(
        "N",
        "the frame to read from a video of EIAs (with --lenses) or of quilts, counted from 0 (default 0)",
        make_integer(0, 999_999),
        "0",
    ),
    "arrangement": Option(
        "NAME",
        "eia: the picture is an elemental image array; mosaic: it shows views side by side, --pixels of them or each "
        "of --lenses pixels; auto: take it as a mosaic only if it certainly is one (default auto)",
        make_name(get_args(Arrangement)),
        "mosaic",
    ),
    "crop": Option(
        "TOP,LEFT,BOTTOM,RIGHT",
        "margins to cut off an elemental image array, in pixels (default 0,0,0,0)",
        values.MARGINS,
        "0,0,7,5",
    ),
    "order": Option(
        "NAME",
        "auto: correct the order of a set of views if it is certainly wrong; given: keep the order; rows, columns: the "
        "first number in the views' names, or the first index, is the row or the column; serpentine: every other row "
        "of views runs from right to left (default auto)",
        make_name(get_args(OrderCheck)),
        "columns",
    ),
    "flip": Option(
        "AXES",
        "reverse the order of views: in u (columns), in v (rows), or in uv, which inverts depth (default none)",
        make_name(get_args(Flip)),
        "v",
    ),
    "transpose": Option("NAME", "yes: swap rows and columns of views", make_switch(get_args(Switch)), "yes", "yes"),
    "depth_sense": Option(
        "NAME",
        "what the views' numbers count: cameras (near content moves to the left from one view to the next on the "
        "right) or lenses (pixels under them; far content moves left); auto: as the file or its format says "
        "(default auto)",
        make_name(("auto", *get_args(DepthSense))),
        "lenses",
    ),
}
"""Options by name, in the order of the help."""


@dataclass(frozen=True)
class ReadingOptions:
    """Values of the options in `READING`."""

    lenses: tuple[int, int] | None = None
    pixels: tuple[int, int] | None = None
    pitch: float | None = None
    delta: float | None = None
    parallax: float | None = None
    """Degrees."""
    pickup: Pickup | None = None
    frame: int = 0
    arrangement: Arrangement = "auto"
    crop: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Pixels: top, left, bottom, right."""
    order: OrderCheck = "auto"
    flip: Flip = "none"
    transpose: Switch = "no"
    depth_sense: Literal["auto", "lenses", "cameras"] = "auto"
