"""Views by OpenGL, one oblique parallel projection for each: what to draw, and whose turn it is.

Pictures are `renderer.backends.opengl`'s; everything in it runs on the thread of `RasterBackend`.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.backends.opengl import Context, Drawing
from ciir.renderer.backends.projections import make_oblique_matrix, make_perspective_matrix
from ciir.renderer.light_field import interleave_views
from ciir.renderer.sampling import average_cells, average_pictures, check_samples
from ciir.renderer.views import parse_views

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

Value = TypeVar("Value", np.uint8, np.float32)

PICTURES_AT_ONCE, SAMPLES_AT_ONCE = 64, 1 << 22
"""Most pictures, and samples in them, that are drawn and held before another caller gets its turn."""


class RasterBackend:
    """One thread owns the EGL context (a context belongs to the thread that made it) and draws for all callers."""

    name = "raster"

    def __init__(self) -> None:
        """Raises `BackendUnavailable` where no context can be made."""
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="egl")
        self._context = self._thread.submit(Context).result()

    def _draw_all(
        self, scene: Scene, drawings: Sequence[Drawing], draw: Callable[[Drawing], NDArray[Value]]
    ) -> Iterator[NDArray[Value]]:
        """Each of `drawings`, which are all of one size, by a method of the context. Callers alternate after some."""
        if not drawings:
            return
        height, width = drawings[0].height, drawings[0].width
        if max(height, width) > self._context.largest:
            raise InvalidOption(
                f"raster: a picture of {height}x{width} samples is larger than the {self._context.largest} that OpenGL "
                "draws here; take fewer lenses, sampling pinhole or backend raytrace"
            )
        together = max(1, min(PICTURES_AT_ONCE, SAMPLES_AT_ONCE // (height * width)))

        def task(some: Sequence[Drawing]) -> list[NDArray[Value]]:
            self._context.load(scene)
            return [draw(drawing) for drawing in some]

        for start in range(0, len(drawings), together):
            yield from self._thread.submit(task, drawings[start : start + together]).result()

    def _draw_colors(
        self, scene: Scene, drawings: Sequence[Drawing], background: tuple[int, int, int]
    ) -> Iterator[NDArray[np.uint8]]:
        for picture in self._draw_all(scene, drawings, self._context.draw):
            yield fill_background(picture, background)

    def render_views(
        self,
        scene: Scene,
        array: LensArray,
        views: Sequence[View],
        *,
        samples: int = 1,
        background: tuple[int, int, int] = (0, 0, 0),
    ) -> Iterator[NDArray[np.uint8]]:
        """See `renderer.backends.Backend.render_views`."""
        check_samples(samples)
        fine = array.refine(samples)
        drawings = [Drawing(partial(make_oblique_matrix, array, view), fine.rows, fine.cols) for view in views]
        for picture in self._draw_colors(scene, drawings, background):
            yield average_cells(picture, samples)

    def render_depth(self, scene: Scene, array: LensArray, views: Sequence[View]) -> Iterator[NDArray[np.float32]]:
        """See `renderer.backends.Backend.render_depth`."""
        drawings = [Drawing(partial(make_oblique_matrix, array, view), array.rows, array.cols) for view in views]
        return self._draw_all(scene, drawings, self._context.draw_depth)

    def render_eia(
        self,
        scene: Scene,
        array: LensArray,
        *,
        samples: int = 1,
        background: tuple[int, int, int] = (0, 0, 0),
    ) -> NDArray[np.uint8]:
        """See `renderer.backends.Backend.render_eia`: one render a view or one a lens, whichever is fewer."""
        if array.pixels_v * array.pixels_u <= array.rows * array.cols * samples**2:
            every = parse_views("all", array.pixels_v, array.pixels_u)
            return interleave_views(
                self.render_views(scene, array, every, samples=samples, background=background), array
            )
        return self.render_by_lens(scene, array, samples=samples, background=background)

    def render_by_lens(
        self,
        scene: Scene,
        array: LensArray,
        *,
        samples: int = 1,
        background: tuple[int, int, int] = (0, 0, 0),
    ) -> NDArray[np.uint8]:
        """The EIA by one perspective render for each lens, or for each of the samples that stand for a lens: the
        field's usual way (elemental content by virtual cameras, ECVIR), and what `elemental` does with few lenses.
        """
        check_samples(samples)
        height, width = array.pixels_v, array.pixels_u
        fine, projection = array.refine(samples), partial(make_perspective_matrix, array)
        lenses = [(row, col) for row in range(array.rows) for col in range(array.cols)]
        drawings = [
            Drawing(projection, height, width, (x, y))
            for row, col in lenses
            for y in fine.lens_y()[row * samples : (row + 1) * samples]
            for x in fine.lens_x()[col * samples : (col + 1) * samples]
        ]
        pictures = self._draw_colors(scene, drawings, background)
        eia = np.empty((array.rows * height, array.cols * width, 4), np.uint8)
        for row, col in lenses:
            image = average_pictures(np.stack(list(islice(pictures, samples**2))), axes=(0,))
            eia[row * height : (row + 1) * height, col * width : (col + 1) * width] = image
        return eia


def fill_background(picture: NDArray[np.uint8], background: tuple[int, int, int]) -> NDArray[np.uint8]:
    """`picture` `(h, w, 4)` with `background` where its alpha is 0. Samples are there or not: nothing is in between."""
    if background != (0, 0, 0):
        picture = picture.copy()
        picture[picture[..., 3] == 0, :3] = background
    return picture
