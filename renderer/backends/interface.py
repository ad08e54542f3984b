"""The interface of the rendering backends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.sampling import average_cells, check_samples
from ciir.renderer.views import parse_views

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

BLACK = (0, 0, 0)


class Backend(ABC):
    """Renders views of a scene given in the lens array's coordinates, in two channels: colour and depth.

    A scene may lie behind the array, in front of it, or reach through it: a sample shows what its whole line hits first
    as seen from in front of the array (+z). `notes`, if given, gets a line for each thing that could not be drawn
    exactly. Backends can be called from several threads at once.
    """

    name: str

    @abstractmethod
    def sample_views(
        self, scene: Scene, array: LensArray, views: Sequence[View], *, notes: set[str] | None = None
    ) -> Iterator[NDArray[np.uint8]]:
        """Yields each of `views` with one point sample per lens, `(rows, cols, 4)` RGBA, RGB times alpha.

        Alpha is 0 or 255, except where see-through surfaces are blended.
        """

    def render_views(
        self,
        scene: Scene,
        array: LensArray,
        views: Sequence[View],
        *,
        samples: int = 1,
        background: tuple[int, int, int] = BLACK,
        notes: set[str] | None = None,
    ) -> Iterator[NDArray[np.uint8]]:
        """Yields the colour of each of `views`, `(rows, cols, 4)` RGBA; alpha is the share of the lens that is
        covered.

        `samples`: point samples along each side of a lens cell, 1 to 16 (see `renderer.sampling`). `background`: RGB, 0
        to 255. Raises `InvalidOption` if `samples` or the size of a view is out of range.
        """
        check_samples(samples)
        for picture in self.sample_views(scene, array.refine(samples), views, notes=notes):
            yield average_cells(fill_background(picture, background), samples)

    @abstractmethod
    def render_depth(self, scene: Scene, array: LensArray, views: Sequence[View]) -> Iterator[NDArray[np.float32]]:
        """Yields the depth of each of `views`, `(rows, cols)`: distance from the array's plane along -z, in scene
        units.

        One ray through each lens's centre is followed to the first surface that it hits. See-through surfaces count
        only if their alpha there is at least `renderer.scene.SOLID`. The depth is +inf if the ray hits none, and
        negative in front of the array. Depths are not averaged over a lens, because the mean of two surfaces lies on
        neither. For more samples, refine the array.

        Raises `InvalidOption` if the size of a view is out of range.
        """

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
        """Returns the elemental image array, `(rows*pixels_v, cols*pixels_u, 4)` RGBA; see `render_views` for the rest.

        Views are rendered one at a time, and `progress(done, total)` counts them.
        """
        every = parse_views("all", array.pixels_v, array.pixels_u)
        views = self.render_views(scene, array, every, samples=samples, background=background, notes=notes)
        eia = np.empty((array.rows * array.pixels_v, array.cols * array.pixels_u, 4), np.uint8)
        for done, ((v, u), view) in enumerate(zip(every, views, strict=True), 1):
            eia[v :: array.pixels_v, u :: array.pixels_u] = view
            progress(done, len(every))
        return eia


def fill_background(picture: NDArray[np.uint8], background: tuple[int, int, int]) -> NDArray[np.uint8]:
    """Returns point samples `(h, w, 4)`, RGB times alpha, over `background`; alpha is kept."""
    if background != BLACK:
        picture = picture.copy()
        shows = picture[..., 3] < 255
        behind = (255 - picture[shows, 3:].astype(np.uint16)) * np.array(background, np.uint16)  # (n, 3)
        picture[shows, :3] += ((behind + 127) // 255).astype(np.uint8)
    return picture
