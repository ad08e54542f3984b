"""Casts arbitrary rays through a scene with Embree and returns their colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends.embree import PASSED, PreparedScene
from ciir.renderer.backends.raytrace import RAYS_PER_BATCH

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.renderer.scene import Scene


WATCHED = 5


class RayCaster:
    """Casts rays into one scene, in any number of threads."""

    def __init__(
        self,
        scene: Scene,
        background: tuple[int, int, int] = (0, 0, 0),
        watch: Callable[[NDArray[np.uint8]], None] | None = None,
    ) -> None:
        """`background`: RGB, 0 to 255, of rays that hit nothing. `watch` gets the colours of one in `WATCHED` rays,
        `(n, 4)`, RGBA over the background, whose alpha is the share that the scene covers, in any order and thread.
        """
        self._watch = watch
        self._prepared = PreparedScene(scene)
        self._background = np.array(background, np.float32)
        self.front = float(scene.bounds()[1, 2])
        """z of the scene's nearest point."""

    def notes(self) -> tuple[str, ...]:
        """Returns notes on what rays so far have left out."""
        return (PASSED,) if self._prepared.passed else ()

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float32]:
        """Returns the colour of each ray, `(n, 3)` RGB, 0 to 255, not rounded.

        `origins`, `directions`: `(n, 3)`. Rays begin in front of the whole scene.
        """
        colors = np.empty((len(origins), 3), np.float32)
        for start in range(0, len(origins), RAYS_PER_BATCH):
            batch = slice(start, start + RAYS_PER_BATCH)
            rgba, _ = self._prepared.cast(origins[batch], directions[batch])
            colors[batch] = rgba[:, :3] * 255 + (1 - rgba[:, 3:]) * self._background
            if self._watch is not None:
                few = np.concatenate([colors[batch][::WATCHED], rgba[::WATCHED, 3:] * 255], axis=1)
                self._watch(np.rint(few).astype(np.uint8))
        return colors

    def cast_lines(self, points: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float32]:
        """Returns the colour of the first surface on each line, for a viewer in front of the scene: `cast` from beyond
        its front.

        `points`: `(n, 3)`, on the lines; `directions`: `(n, 3)`, away from the viewer, `z < 0`.
        """
        steps = np.maximum(self.front - points[:, 2], 0.0) / directions[:, 2]
        return self.cast(points + steps[:, None] * directions, directions)
