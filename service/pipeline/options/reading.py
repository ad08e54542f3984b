"""Options that say how an input lies in front of the lenses: the lens array, and the order of views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from ciir.renderer.light_field import OrderCheck, Pickup
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import make_name, make_number

READING = {
    "lenses": Option(
        "RxC",
        "rows x columns of lenses (a mesh: 100x100 by default; an EIA needs this or --pixels)",
        values.PAIR,
        "50x50",
    ),
    "pixels": Option(
        "KvxKu", "rows x columns of pixels under each lens (a mesh: 15x15 by default)", values.PAIR, "9x9"
    ),
    "pitch": Option(
        "LENGTH", "distance between lenses in scene units (a mesh: 1 by default)", make_number(1e-9, 1e9), "0.5"
    ),
    "delta": Option(
        "TANGENT",
        "pixel size / gap (a mesh: 0.4 / the larger count of pixels by default)",
        make_number(1e-9, 1e9),
        "0.02",
    ),
    "parallax": Option(
        "DEGREES",
        "the whole viewing angle, in place of --delta (a mesh: 22.6 by default)",
        make_number(0.01, 170, "degrees such as 30"),
        "30",
    ),
    "pickup": Option(
        "NAME",
        "virtual: elemental images are upright; optical: turned by 180 degrees (default virtual)",
        make_name(get_args(Pickup)),
        "optical",
    ),
    "order": Option(
        "NAME",
        "auto: put a set of views right whose order is certainly wrong; given: keep the order (default auto)",
        make_name(get_args(OrderCheck)),
        "given",
    ),
}
"""By name, in the order of the help."""


@dataclass(frozen=True)
class ReadingOptions:
    """Values of the options in `READING`."""

    lenses: tuple[int, int] | None = None
    pixels: tuple[int, int] | None = None
    pitch: float | None = None
    delta: float | None = None
    parallax: float | None = None
    """Degrees."""
    pickup: Pickup = "virtual"
    order: OrderCheck = "auto"
