"""Renders views with OpenGL, one oblique parallel projection each, on one thread for all callers."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.backends.interface import BLACK, Backend, fill_background
from ciir.renderer.backends.opengl import Context, Drawing
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.backends.projections import make_oblique_matrix, make_perspective_matrix
from ciir.renderer.sampling import average_pictures, check_samples
from ciir.renderer.scene import SOLID

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

Value = TypeVar("Value", np.uint8, np.float32)

PICTURES_PER_BATCH, SAMPLES_PER_BATCH = 64, 1 << 22
"""Most pictures, and samples in them, that are drawn and held before the thread serves another caller."""
NOT_BLENDED = (
    f"raster: see-through materials are drawn solid where alpha is {SOLID} or more, and not at all below; backend "
    "raytrace blends them"
)


class RasterBackend(Backend):
    """Draws on the one thread that owns the EGL context: a context belongs to the thread that made it."""

    name = "raster"

    def __init__(self) -> None:
        """Raises `BackendUnavailable` if OpenGL doesn't work."""
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="egl")
        self._context = self._thread.submit(Context).result()

    def sample_views(
        self, scene: Scene, array: LensArray, views: Sequence[View], *, notes: set[str] | None = None
    ) -> Iterator[NDArray[np.uint8]]:
        """See `Backend.sample_views`."""
        if scene.is_see_through and notes is not None:
            notes.add(NOT_BLENDED)
        return self._draw(scene, _oblique_drawings(array, views), self._context.draw_color)

    def render_depth(self, scene: Scene, array: LensArray, views: Sequence[View]) -> Iterator[NDArray[np.float32]]:
        """See `Backend.render_depth`."""
        return self._draw(scene, _oblique_drawings(array, views), self._context.draw_depth)

    def render_eia(
        self,
        scene: Scene,
        array: LensArray,
        *,
        samples: int = 1,
        background: tuple[int, int, int] = BLACK,
        notes: set[str] | None = None,
        progress: Progress = ignore_progress,
    ) -> NDArray[np.uint8]:
        """See `Backend.render_eia`. Draws and counts views or lenses, whichever are fewer. A camera at a lens sees
        nothing in front of the array, so views are drawn if the scene reaches there.
        """
        by_view = array.pixels_v * array.pixels_u <= array.rows * array.cols * samples**2
        if by_view or scene.bounds()[1, 2] >= 0:
            return super().render_eia(
                scene, array, samples=samples, background=background, notes=notes, progress=progress
            )
        if scene.is_see_through and notes is not None:
            notes.add(NOT_BLENDED)
        return self.render_by_lens(scene, array, samples=samples, background=background, progress=progress)

    def render_by_lens(
        self,
        scene: Scene,
        array: LensArray,
        *,
        samples: int = 1,
        background: tuple[int, int, int] = BLACK,
        progress: Progress = ignore_progress,
    ) -> NDArray[np.uint8]:
        """Returns the elemental image array of a scene behind the array, drawn by one perspective projection for each
        sample of each lens, as virtual cameras do.
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
        pictures = self._draw(scene, drawings, self._context.draw_color)
        eia = np.empty((array.rows * height, array.cols * width, 4), np.uint8)
        for done, (row, col) in enumerate(lenses, 1):
            of_lens = [fill_background(picture, background) for picture in islice(pictures, samples**2)]
            image = average_pictures(np.stack(of_lens), axes=(0,))
            eia[row * height : (row + 1) * height, col * width : (col + 1) * width] = image
            progress(done, len(lenses))
        return eia

    def _draw(
        self, scene: Scene, drawings: Sequence[Drawing], draw: Callable[[Drawing], NDArray[Value]]
    ) -> Iterator[NDArray[Value]]:
        """Yields each of `drawings`, all of one size, drawn by a context method; the thread alternates between
        callers.
        """
        if not drawings:
            return
        height, width = drawings[0].height, drawings[0].width
        if max(height, width) > self._context.largest:
            raise InvalidOption(
                f"raster: a picture of {height}x{width} samples is larger than the {self._context.largest} that OpenGL "
                "draws here; take fewer lenses, sampling pinhole or backend raytrace"
            )
        size = max(1, min(PICTURES_PER_BATCH, SAMPLES_PER_BATCH // (height * width)))

        def draw_batch(batch: Sequence[Drawing]) -> list[NDArray[Value]]:
            self._context.load(scene)
            return [draw(drawing) for drawing in batch]

        for start in range(0, len(drawings), size):
            yield from self._thread.submit(draw_batch, drawings[start : start + size]).result()


def _oblique_drawings(array: LensArray, views: Sequence[View]) -> list[Drawing]:
    return [Drawing(partial(make_oblique_matrix, array, view), array.rows, array.cols) for view in views]
