"""Views in turn: rendered from a mesh, or mapped from pictures. The pipeline treats both alike."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from service.plan import check_samples, mesh_array

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from renderer.light_field import LightField
    from renderer.pictures import Pixels
    from renderer.scene import Scene
    from service.plan import Plan
    from service.report import Clock, Report
    from service.request import Options

View = tuple[int, int]


class MeshViews:
    """Renders a mesh, RGB, framed in front of the lens array that the options ask for."""

    def __init__(self, scene: Scene, options: Options, plan: Plan, clock: Clock) -> None:
        """Places the scene and opens the backend; raises `TooLarge`, `InvalidOption` or `BackendUnavailable`."""
        self.array = mesh_array(options)
        self._rendered = self.array.refined(plan.enlarge) if plan.strategy == "direct" else self.array
        check_samples(self._rendered, plan.samples)
        self._plan, self._clock, self._background = plan, clock, options.background
        with clock.stage("render"):
            from renderer.backends import open_backend
            from renderer.framing import frame

            rays = self._rendered.rows * self._rendered.cols * plan.samples**2
            self._backend, reason = open_backend(options.backend, triangles=scene.triangles, rays=rays)
            matrix = frame(scene, self.array)
            self._scene = scene.transformed(matrix)
        self.backend: str | None = self._backend.name
        self.reasons = [reason]
        self.transform: list[list[float]] | None = matrix.tolist()
        self.packages = ("embreex" if self.backend == "raytrace" else "pyrender",)
        self.lenses = (self.array.rows, self.array.cols)
        self.pixels = (self.array.pixels_v, self.array.pixels_u)

    def lens_array(self) -> Report:
        """The report's `lens_array`."""
        return _described(self.lenses, self.pixels, self.array.pitch, self.array.delta)

    def make(self, views: Sequence[View]) -> Iterator[NDArray[Any]]:
        """Each view as `(rows, cols, 3)` 8 bit; for `direct` as many pixels as are asked for."""
        pictures = self._backend.views(
            self._scene, self._rendered, views, samples=self._plan.samples, background=self._background
        )
        return (picture[..., :3] for picture in pictures)

    def batch(self, pictures: Iterator[NDArray[Any]], count: int) -> Pixels:
        """The next `count` of `make`, `(count, H, W, 3)`."""
        with self._clock.stage("render"):
            return np.stack(list(islice(pictures, count)))

    def elemental(self) -> NDArray[np.uint8]:
        """The elemental image array, `(rows*pixels_v, cols*pixels_u, 3)`."""
        with self._clock.stage("render"):
            eia = self._backend.elemental(
                self._scene, self.array, samples=self._plan.samples, background=self._background
            )
            return np.ascontiguousarray(eia[..., :3])


class PictureViews:
    """Maps views out of a light field, pixel for pixel, with its channels and depth."""

    backend: str | None = None
    transform: list[list[float]] | None = None
    reasons: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()

    def __init__(self, field: LightField, options: Options, clock: Clock) -> None:
        self._field, self._clock = field, clock
        self._pitch, self._delta = options.pitch, options.delta
        pixels_v, pixels_u, rows, cols, _ = field.views.shape
        self.lenses, self.pixels = (rows, cols), (pixels_v, pixels_u)

    def lens_array(self) -> Report:
        """The report's `lens_array`; pitch and delta are null where nobody said them."""
        return _described(self.lenses, self.pixels, self._pitch, self._delta)

    def make(self, views: Sequence[View]) -> Iterator[NDArray[Any]]:
        """Each view, `(rows, cols, channels)`, in the light field's memory."""
        return (self._field.views[v, u] for v, u in views)

    def batch(self, pictures: Iterator[NDArray[Any]], count: int) -> Pixels:
        """The next `count` of `make`, copied together: `(count, rows, cols, channels)`."""
        with self._clock.stage("map"):
            return np.stack(list(islice(pictures, count)))


def _described(lenses: tuple[int, int], pixels: tuple[int, int], pitch: float | None, delta: float | None) -> Report:
    return {
        "rows": lenses[0],
        "cols": lenses[1],
        "pitch": pitch,
        "pixels_v": pixels[0],
        "pixels_u": pixels[1],
        "delta": delta,
    }
