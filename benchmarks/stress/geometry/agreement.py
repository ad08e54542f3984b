"""Compares rendered pictures with ray casting: colours away from edges, and the position of edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.geometry.rays import build_embree_sight, build_slow_sight
from ciir.errors import BackendUnavailable
from ciir.renderer.backends import open_backend

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.benchmarks.stress.geometry.rays import Sight, Values
    from ciir.renderer.backends import Backend
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

SNAP = np.sqrt(2) / 512
"""The most by which OpenGL moves a vertex, in pixels: x and y each to the nearest 1/256."""
BAND = 1 / 128
"""The distance from a sample, in pixels, within which edges are looked for with raster: the power of two above `SNAP`,
doubled."""
FLOAT_BAND = 1 / 1024
"""The band for rays cast in float32: a hundred times as far as their roundings move an edge."""
STEP = 16.0
"""The least difference in levels between two samples that counts as an edge between them."""
RASTER_LEVELS = 3.0
"""Rounding to 8 bits (0.5), texture weights of 8 bits along u and v (1 each), a texel's slope over `SNAP` (0.5)."""
RAY_LEVELS = 0.6
"""Rounding to 8 bits (0.5), and float32 weights times texels' slopes."""
_RADII = [2.0**-k for k in range(10, -1, -1)]


@dataclass(frozen=True)
class Agreement:
    """The result of comparing a picture with rays."""

    worst: float
    """The largest difference where the rays around a sample agree, in levels of 8 bits."""
    at: str
    """The place of that difference."""
    moved: int
    """Pixels at edges that differ."""
    edges: int
    """Neighbours that differ by more than was allowed: the length of all edges in pixels, or more."""
    silhouette: float
    """How far from its place the object's outline is drawn, in pixels; infinite over one."""
    covered: int
    """Pixels that show the object."""

    def list_bounds(self, what: str) -> Iterator[Found]:
        """Yields the three numbers of the raster backend, with their bounds."""
        yield Found(f"{what}: worst colour away from edges, levels", RASTER_LEVELS, self.worst, self.at)
        expected = SNAP * self.edges  # an edge that moves by SNAP sweeps over as many samples as it is long times that
        most = expected + 4 * np.sqrt(expected) + 1
        covered = max(1, self.covered)
        yield Found(f"{what}: share of pixels that differ, at edges", most / covered, self.moved / covered)
        yield Found(f"{what}: silhouette from its place, pixels", BAND, self.silhouette)


def open_backends(what: str) -> tuple[list[Backend], list[Skipped]]:
    """Opens ray casting and raster, and returns the reason if the latter can't run."""
    rays = open_backend("raytrace")[0]
    try:
        return [rays, open_backend("raster")[0]], []
    except BackendUnavailable as error:
        return [rays], [Skipped(f"{what}: raster", str(error))]


def compare_backends(
    what: str, placed: Scene, array: LensArray, views: Sequence[View], *, slow: int
) -> Iterator[Found | Skipped]:
    """Compares rays with `slow` rays of each view in float64, and raster with both."""
    reference = build_slow_sight(placed)
    backends, skipped = open_backends(what)
    yield from skipped
    for backend in backends:
        pictures = list(backend.render_views(placed, array, views))
        is_raster = backend.name == "raster"
        allowed, band = (RASTER_LEVELS, BAND) if is_raster else (RAY_LEVELS, FLOAT_BAND)
        exact = compare(pictures, views, array, reference, allowed=allowed, band=band, some=slow)
        yield Found(f"{what}: {backend.name} against float64, worst colour, levels", allowed, exact.worst, exact.at)
        if is_raster:
            yield from compare(pictures, views, array, build_embree_sight(placed)).list_bounds(
                f"{what}: raster against rays"
            )


def locate_samples(array: LensArray, row: NDArray[np.intp], col: NDArray[np.intp]) -> Values:
    """Returns the positions of the samples of these pixels `(n,)`, `(n, 3)`, in the array's plane."""
    return np.stack([array.lens_x()[col], array.lens_y()[row], np.zeros(len(row))], axis=1)


def compute_direction(array: LensArray, view: View) -> Values:
    """Returns the direction that all rays of the view have, `(3,)`."""
    return np.array([array.tangent_x()[view[1]], array.tangent_y()[view[0]], -1.0])


def cast_ring(sight: Sight, start: Values, along: Values, radius: float, rays: int) -> Values:
    """Returns the colours of `rays` rays at `radius` scene units around each of `start` `(n, 3)`: `(n, rays, 4)`."""
    angle = np.arange(rays) * (2 * np.pi / rays)
    ring = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(rays)], axis=1)
    return sight((start[:, None] + ring).reshape(-1, 3), along).reshape(len(start), rays, 4)


def compare(
    pictures: Sequence[NDArray[np.uint8]],
    views: Sequence[View],
    array: LensArray,
    sight: Sight,
    *,
    allowed: float = RASTER_LEVELS,
    band: float = BAND,
    some: int = 0,
) -> Agreement:
    """Compares `pictures` `(rows, cols, 4)`, one for each of `views`, with the colours of `sight` along the same rays.

    A pixel that differs by more than `allowed` levels is at an edge if rays within `band` pixels of its sample differ
    by more than `STEP` levels. `some`: how many pixels of each view to draw at random; 0: all.
    """
    worst, at, moved, edges, silhouette, covered = 0.0, "", 0, 0, 0.0, 0
    random = np.random.default_rng(0)
    for view, picture in zip(views, pictures, strict=True):
        along = compute_direction(array, view)
        every = np.arange(array.rows * array.cols)
        index = random.choice(every, some, replace=False) if some else every
        row, col = np.divmod(index, array.cols)
        start = locate_samples(array, row, col)
        seen, drawn = sight(start, along), picture[row, col].astype(np.float64)
        difference = np.abs(drawn - seen).max(axis=1)
        off = np.flatnonzero(difference > allowed)
        is_edge = np.zeros(len(index), bool)
        if len(off):
            ring = cast_ring(sight, start[off], along, band * array.pitch, 8)
            is_edge[off] = (np.abs(ring - seen[off, None]) > STEP).any(axis=(1, 2))
        inside = np.where(is_edge, 0.0, difference)
        if inside.max() > worst:
            worst, place = float(inside.max()), int(inside.argmax())
            at = f"view {view[0]},{view[1]}, pixel {row[place]},{col[place]}"
        moved += int(is_edge.sum())
        covered += int((seen[:, 3] > 0).sum())
        if not some:
            edges += _count_differing_neighbours(seen.reshape(array.rows, array.cols, 4), allowed)
        cut = is_edge & ((drawn[:, 3] > 0) != (seen[:, 3] > 0))
        if cut.any():
            silhouette = max(silhouette, _find_edge_distance(sight, start[cut], along, drawn[cut, 3] > 0, array.pitch))
    return Agreement(worst, at, moved, edges, silhouette, covered)


def _count_differing_neighbours(seen: Values, allowed: float) -> int:
    """Counts pairs of neighbours in `(rows, cols, 4)` that differ by more than `allowed`."""
    return sum(int((np.abs(np.diff(seen, axis=axis)).max(axis=2) > allowed).sum()) for axis in (0, 1))


def _find_edge_distance(sight: Sight, start: Values, along: Values, covered: NDArray[np.bool_], pitch: float) -> float:
    """Returns the largest distance from one of `start` to the nearest ray whose coverage is that in `covered` `(n,)`,
    in pixels.
    """
    for radius in _RADII:
        ring = cast_ring(sight, start, along, radius * pitch, 32)
        left = ~((ring[..., 3] > 0) == covered[:, None]).any(axis=1)
        if not left.any():
            return radius
        start, covered = start[left], covered[left]
    return float("inf")
