"""The types of the options that `ciir.reconstruct` takes, for editors and type checkers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypedDict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.models.light_field.fusion import Fusion
    from ciir.renderer.placement import Fit, Up
    from ciir.renderer.readers.layout import Arrangement, OrderCheck
    from ciir.renderer.views import Flip, Pickup, View
    from ciir.service.pipeline.options import Backend, Sampling
    from ciir.service.pipeline.options.lenslet import GridShape, Pitch
    from ciir.service.pipeline.options.upscaling import Strategy


class ReconstructionOptions(TypedDict, total=False):
    """Options that may be left out. None means the default, and text is parsed as on the command line."""

    lenses: tuple[int, int] | str | None
    pixels: tuple[int, int] | str | None
    pitch: float | None
    delta: float | None
    parallax: float | None
    pickup: Pickup | None
    frame: int
    arrangement: Arrangement
    crop: tuple[int, int, int, int] | str
    order: OrderCheck
    flip: Flip
    transpose: bool
    depth_sense: Literal["auto", "lenses", "cameras"]
    lens_pitch: Pitch | None
    lens_offset: tuple[float, float] | str | None
    lens_rotation: float | None
    lens_grid: GridShape
    views: str | Sequence[View]
    model: str
    scale: int
    strategy: Strategy
    fusion: Fusion
    skip: bool
    up: Up
    rotate: float | tuple[float, float, float] | str
    zoom: float
    place: float | None
    depth_factor: float
    fit: Fit
    light: tuple[float, float] | str | None
    backend: Backend
    sampling: Sampling
    background: tuple[int, int, int] | str
    time: float | Sequence[float] | str | None
    animation: str | int | None
    camera: str | int | None
    neighbour_time: float
