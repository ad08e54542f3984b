"""Renders views by casting every ray: the exact reference, which also runs without OpenGL."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ciir.cores import count_available_cores
from ciir.renderer.backends.embree import PASSED, PreparedScene
from ciir.renderer.backends.interface import Backend

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from concurrent.futures import Future

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

    RayBatch = tuple[slice, NDArray[np.float64], NDArray[np.float64]]
    """Slice of the rays, their origins `(n, 3)` and their directions, `(n, 3)` or `(3,)`."""

Value = TypeVar("Value", np.uint8, np.float32)

RAYS_PER_BATCH = 1 << 14
RAYS_AT_ONCE = 1 << 17
"""Most rays of views that are cast together (a single view may have more); the next views are cast meanwhile."""


class RaytraceBackend(Backend):
    """Casts one ray for each sample along the whole line through its point on the lens array."""

    name = "raytrace"

    def sample_views(
        self, scene: Scene, array: LensArray, views: Sequence[View], *, notes: set[str] | None = None
    ) -> Iterator[NDArray[np.uint8]]:
        """See `Backend.sample_views`."""
        prepared = PreparedScene(scene)

        def cast(picture: NDArray[np.uint8], part: RayBatch) -> None:
            rays, origins, direction = part
            picture[rays] = prepared.cast_levels(origins, direction)

        for picture in _cast_views(array, views, lambda rays: np.empty((rays, 4), np.uint8), cast):
            if prepared.passed and notes is not None:
                notes.add(PASSED)
            yield picture.reshape(array.rows, array.cols, 4)

    def render_depth(self, scene: Scene, array: LensArray, views: Sequence[View]) -> Iterator[NDArray[np.float32]]:
        """See `Backend.render_depth`."""
        prepared = PreparedScene(scene)

        def cast(picture: NDArray[np.float32], part: RayBatch) -> None:
            rays, origins, direction = part
            picture[rays] = prepared.cast(origins, direction)[1]  # the direction's z is -1

        for picture in _cast_views(array, views, lambda rays: np.empty(rays, np.float32), cast):
            yield picture.reshape(array.rows, array.cols)


def list_rays(array: LensArray, views: Sequence[View]) -> Iterator[RayBatch]:
    """Yields the rays of views, one view after another and row by row: their slice, their origins `(n, 3)` and their
    directions, `(3,)` if all are of one view, else `(n, 3)`.

    A batch is some whole views or some rows of one: small ones would cost more in Python than in Embree.
    """
    count = array.rows * array.cols
    together, height = max(1, RAYS_PER_BATCH // count), max(1, RAYS_PER_BATCH // array.cols)
    tangent_x, tangent_y = array.tangent_x(), array.tangent_y()
    for first in range(0, len(views), together):
        some = views[first : first + together]
        directions = np.array([[tangent_x[u], tangent_y[v], -1.0] for v, u in some])
        for top in range(0, array.rows, height):
            bottom = min(top + height, array.rows)
            rays = slice(first * count + top * array.cols, (first + len(some) - 1) * count + bottom * array.cols)
            along = directions[0] if len(some) == 1 else directions.T.repeat(count, axis=1).T
            yield rays, _list_origins(array, top, bottom, len(some)), along


@lru_cache(maxsize=16)  # all views of an array have the same origins
def _list_origins(array: LensArray, top: int, bottom: int, views: int) -> NDArray[np.float64]:
    """Returns the centres of the lenses of some rows, row by row, as often as there are views, `(n, 3)`, read-only."""
    axes = np.zeros((3, views, bottom - top, array.cols))  # by axis: rows of 3 are slow in NumPy
    axes[0], axes[1] = array.lens_x(), array.lens_y()[top:bottom, None]
    axes.flags.writeable = False
    return axes.reshape(3, -1).T


def _cast_views(
    array: LensArray,
    views: Sequence[View],
    make: Callable[[int], NDArray[Value]],
    cast: Callable[[NDArray[Value], RayBatch], None],
) -> Iterator[NDArray[Value]]:
    """Yields a picture of each view: its part of what `make` makes for a number of rays and `cast` fills, on all
    cores.
    """
    count = array.rows * array.cols
    size = max(1, RAYS_AT_ONCE // count)
    with ThreadPoolExecutor(count_available_cores(), thread_name_prefix="rays") as pool:

        def begin(first: int) -> tuple[NDArray[Value], list[Future[None]]]:
            some = views[first : first + size]
            made = make(len(some) * count)
            return made, [pool.submit(cast, made, part) for part in list_rays(array, some)]

        coming = begin(0)
        for first in range(size, len(views) + size, size):
            (made, parts), coming = coming, begin(first)  # empty after the last
            for part in parts:
                part.result()
            yield from made.reshape(-1, count, *made.shape[1:])
