"""The job: everything that the options and the input determine together, resolved once and frozen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, UnknownModel
from ciir.models import catalogue
from ciir.models.light_field.strides import choose_stride
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray, compute_delta
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.view_set.view_files import ViewFiles
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.renderer.scene import Scene
from ciir.renderer.view_order.estimate import estimate_order
from ciir.renderer.view_order.motion import measure_motion
from ciir.renderer.views import parse_views
from ciir.service.pipeline.limits import check_view_count
from ciir.service.pipeline.options import AUTO, MESH, NO_MODEL, Options
from ciir.service.pipeline.stages.arrangement import Arrangement, arrange_views

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ciir.models.light_field.fusion import Fusion
    from ciir.renderer.placement import Placement
    from ciir.renderer.view_order.estimate import OrderEstimate
    from ciir.renderer.views import DepthSense, View
    from ciir.service.pipeline.options import Backend, Sampling, Strategy
    from ciir.service.pipeline.source import Content

LENSES, PIXELS = (100, 100), (15, 15)
"""The lens array in front of a mesh if the options don't give one."""


@dataclass(frozen=True, eq=False)
class Job:
    """What a reconstruction has to do. Later stages don't look at options."""

    name: str
    """The input's name, for messages."""
    content: Content
    lenses: tuple[int, int]
    """Rows and columns: the pixels of a view."""
    grid: tuple[int, int]
    """Rows and columns of views: the pixels under a lens."""
    pitch: float | None
    """Distance between lenses, in scene units; None if it is unknown."""
    delta: float | None
    """Tangent from one pixel to the next; None if it is unknown."""
    wanted: tuple[View, ...]
    model: str
    """A name of the catalogue, `auto` or `none`."""
    scale: int
    strategy: Strategy
    backend: Backend
    sampling: Sampling
    """How the lenses sample the scene, or sampled it."""
    background: tuple[int, int, int]
    placement: Placement
    """The placement of a mesh."""
    neighbour_time: float
    """Most seconds, as predicted for a typical machine, that `auto` spends on a light-field network for which
    neighbouring views are rendered."""
    fusion: Fusion
    """Which views of a light field are fused with the upscaled views around them."""
    skip: bool
    """Whether triangles and pixels that can't change the result are skipped."""
    frames: int = 1
    """How many times the job is done: once, or for a mesh at each of several times or yaws."""
    max_pixels: int | None = None
    """Most output pixels, and most samples of a mesh, of all views and frames together."""

    @property
    def mesh(self) -> Scene | None:
        """The mesh; None for a light field."""
        return self.content if isinstance(self.content, Scene) else None

    @cached_property
    def array(self) -> LensArray:
        """The lens array, with a pitch of 1 and a usual delta if they are unknown."""
        return LensArray(*self.lenses, *self.grid, self.pitch or 1.0, self.delta or 0.0)

    @cached_property
    def scene_transform(self) -> NDArray[np.float64]:
        """The 4x4 matrix that places the mesh at the lens array. Computed once, because it passes over all vertices."""
        assert self.mesh is not None  # noqa: S101 - a light field is not placed
        return frame_scene(self.mesh, self.array, self.placement)

    @property
    def samples(self) -> int:
        """A mesh's samples along each side of a lens's cell; 1 for a light field."""
        return LENSLET_SAMPLES if self.mesh is not None and self.sampling == "lenslet" else 1

    @property
    def depth_sense(self) -> DepthSense:
        """How views move with depth. A mesh's views are those of a lens array."""
        return "lenses" if isinstance(self.content, Scene) else self.content.depth_sense

    @property
    def pixel_aspect(self) -> float:
        """The same as `LightField.pixel_aspect`."""
        return self.content.pixel_aspect if isinstance(self.content, LightField) else 1.0

    @property
    def is_jpeg(self) -> bool:
        """The same as `LightField.is_jpeg`."""
        return isinstance(self.content, LightField) and self.content.is_jpeg

    @cached_property
    def is_transparent(self) -> bool:
        """Whether any pixel of any view that may be used is not opaque. A mesh's views are opaque."""
        if isinstance(self.content, ViewFiles):
            has_alpha = self.content.shape[4] in (2, 4)
            required = self.arrangement.list_required if self.fusion == "never" else self.arrangement.list_fused
            return has_alpha and self.content.is_transparent(required(self.wanted))
        return isinstance(self.content, LightField) and self.content.is_transparent()

    @cached_property
    def order(self) -> OrderEstimate | None:
        """The estimated order of a light field's views; None for a mesh, and if the order is known to be right."""
        if isinstance(self.content, Scene) or self.content.is_ordered:
            return None
        return estimate_order(self.content if isinstance(self.content, ViewFiles) else self.content.views)

    @cached_property
    def arrangement(self) -> Arrangement:
        """Which views are neighbours.

        The windows of a set of views always consist of the nearest ones: measuring how far content moves would decode
        views that may not be needed.
        """
        arrangement = arrange_views(self.grid, self.order)
        if not isinstance(self.content, LightField) or arrangement.places is not None:
            return arrangement
        return replace(arrangement, stride=choose_stride(measure_motion(self.content.views), self.grid))


def resolve_job(name: str, content: Content, options: Options, *, max_views: int, max_pixels: int | None = None) -> Job:
    """Resolves the job that `options` ask for with `content`, which was read from the input `name`.

    Raises `InvalidOption` if an option doesn't fit the kind of input, `UnknownModel`, and `TooLarge` if more than
    `max_views` views are asked for.
    """
    if isinstance(content, Scene):
        array = resolve_array(options)
        lenses, grid = (array.rows, array.cols), (array.pixels_v, array.pixels_u)
        pitch: float | None = array.pitch
        delta: float | None = array.delta
    else:
        views_v, views_u, rows, cols, _ = content.shape
        lenses, grid = (rows, cols), (views_v, views_u)
        pitch = options.pitch or (content.lens_pitch if isinstance(content, LightField) else None)
        delta = _resolve_delta(options, grid)
    check_view_count(options.views, grid, max_views)
    wanted = _parse_views(content, options, grid)
    check_kind(name, content, options, is_upscaled=options.model != NO_MODEL)
    known = (*catalogue.list_names(), AUTO, NO_MODEL)
    if options.model not in known:
        advice = catalogue.advise_export(options.model[:40])
        raise UnknownModel(f"model: no {options.model[:40]!r} here; give one of {', '.join(known)}{advice}")
    return Job(
        name=name,
        content=content,
        lenses=lenses,
        grid=grid,
        pitch=pitch,
        delta=delta,
        wanted=wanted,
        model=options.model,
        scale=options.scale,
        strategy=options.strategy,
        backend=options.backend,
        sampling=options.sampling,
        background=options.background,
        placement=options.placement,
        neighbour_time=options.neighbour_time,
        fusion=options.fusion,
        skip=options.skip == "exact",
        max_pixels=max_pixels,
    )


def resolve_array(options: Options) -> LensArray:
    """Returns the lens array in front of a mesh; by default 100x100 lenses of 15x15 pixels with a pitch of 1."""
    rows, cols = options.lenses or LENSES
    pixels_v, pixels_u = options.pixels or PIXELS
    delta = _resolve_delta(options, (pixels_v, pixels_u)) or 0.0
    return LensArray(rows, cols, pixels_v, pixels_u, options.pitch or 1.0, delta)


def _resolve_delta(options: Options, grid: tuple[int, int]) -> float | None:
    if options.parallax is None:
        return options.delta
    if options.delta is not None:
        raise InvalidOption("delta, parallax: both give the viewing angle; leave one of them out")
    return compute_delta(options.parallax, *grid)


def _parse_views(content: Content, options: Options, grid: tuple[int, int]) -> tuple[View, ...]:
    try:
        return tuple(parse_views(options.views, *grid))
    except InvalidOption as error:
        notes = () if isinstance(content, Scene) else content.notes
        order = "".join(f" ({note})" for note in notes if note.startswith(("order: ", "views: ")))
        raise InvalidOption(f"{error}{order}") from error


def check_kind(name: str, content: Content, options: Options, *, is_upscaled: bool = False) -> None:
    """Raises `InvalidOption` for an option that is for the other kind of input.

    `sampling` is also for pictures that are upscaled.
    """
    if isinstance(content, Scene):
        if options.pickup == "optical":
            raise InvalidOption(f"pickup: optical is for elemental image arrays and {name} is a mesh; leave it out")
        for option in ("frame", "arrangement", "crop", "order", "flip", "transpose", "depth_sense"):
            if getattr(options, option) != getattr(Options, option):
                raise InvalidOption(f"{option}: this is for pictures and {name} is a mesh; leave it out")
        return
    for option in MESH:
        if option == "sampling" and is_upscaled:
            continue
        if getattr(options, option) != getattr(Options, option):
            kinds = "meshes and upscaled views" if option == "sampling" else "meshes"
            flatter = ", or give only the middle views, which have less depth" if option == "depth_factor" else ""
            raise InvalidOption(f"{option}: this is for {kinds} and {name} holds pictures; leave it out{flatter}")
    if options.strategy == "direct":
        raise InvalidOption(f"strategy: direct renders a mesh and {name} holds pictures; give upscale or auto")
