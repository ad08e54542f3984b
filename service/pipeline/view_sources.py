"""Views in turn: rendered from a mesh, or mapped from pictures. The pipeline treats both alike."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.backends.culling import cull_if_worthwhile
from ciir.service.pipeline.plan import check_samples, mesh_array

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.plan import Plan
    from ciir.service.pipeline.report import Clock, Report


class MeshViews:
    """Renders a mesh, RGB, framed in front of the lens array that the options ask for."""

    def __init__(self, scene: Scene, options: Options, plan: Plan, clock: Clock) -> None:
        """Raises `TooLarge` or `InvalidOption`; nothing is rendered or opened yet."""
        self.array = mesh_array(options)
        self._rendered = self.array.refine(plan.enlarge) if plan.strategy == "direct" else self.array
        self.samples = check_samples(self._rendered, plan.samples, plan.strategy)
        self._given, self._plan, self._clock = scene, plan, clock
        self._wanted, self._background = options.backend, options.background
        self._culls = options.skip == "exact"
        self._is_seen = False
        self._left = scene.triangles
        self.lenses = (self.array.rows, self.array.cols)
        self.pixels = (self.array.pixels_v, self.array.pixels_u)
        self.sample: Pixels = np.zeros((1, 1, 3), np.uint8)

    def start(self) -> None:
        """Opens the backend and places the scene; before `make` and `elemental`. Raises `BackendUnavailable`."""
        with self._clock.stage("render"):
            from ciir.renderer.backends import open_backend
            from ciir.renderer.framing import frame_scene

            self._backend, reason = open_backend(self._wanted, triangles=self._given.triangles, rays=self.samples)
            matrix = frame_scene(self._given, self.array)
            self._scene = self._given.transform(matrix)
        self.backend: str | None = self._backend.name
        self.reasons: Sequence[str] = [reason]
        self.transform: list[list[float]] | None = matrix.tolist()
        self.packages: tuple[str, ...] = ("embreex" if self.backend == "raytrace" else "pyrender",)

    def notes(self) -> list[str]:
        """What a caller should hear of, once everything was made."""
        if self._is_seen:
            return [*self._given.notes]
        unseen = "nothing that was asked for shows the object, only background; ask for other views or another delta"
        return [*self._given.notes, unseen]

    def lens_array(self) -> Report:
        """The report's `lens_array`."""
        return _described(self.lenses, self.pixels, self.array.pitch, self.array.delta)

    def make(self, views: Sequence[View]) -> Iterator[NDArray[Any]]:
        """Each view as `(rows, cols, 3)` 8 bit; for `direct` as many pixels as are asked for."""
        scene, samples = self._scene, self._plan.samples
        if self._culls:
            with self._clock.stage("render"):
                scene = cull_if_worthwhile(scene, self._rendered, views, self._backend.name, samples=samples)
                self._left = scene.triangles
        pictures = self._backend.render_views(
            scene, self._rendered, views, samples=samples, background=self._background
        )
        return map(self._opaque, pictures)

    def skipped(self) -> Report:
        """The report's `skipped`, once everything was made: the share of triangles that were `culled`."""
        return {"culled": round(1 - self._left / self._given.triangles, 4)}

    def take(self, pictures: Iterator[NDArray[Any]], count: int) -> list[Pixels]:
        """The next `count` of `make`, `(H, W, 3)` each."""
        with self._clock.stage("render"):
            return [np.ascontiguousarray(picture) for picture in islice(pictures, count)]

    def elemental(self) -> NDArray[np.uint8]:
        """The elemental image array, `(rows*pixels_v, cols*pixels_u, 3)`."""
        with self._clock.stage("render"):
            eia = self._backend.render_eia(
                self._scene, self.array, samples=self._plan.samples, background=self._background
            )
            return np.ascontiguousarray(self._opaque(eia))

    def _opaque(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """RGBA without A, the share that the object covers."""
        self._is_seen = self._is_seen or bool(picture[..., 3].any())
        return picture[..., :3]


class PictureViews:
    """Maps views out of a light field, pixel for pixel, with its channels and depth."""

    backend: str | None = None
    transform: list[list[float]] | None = None
    reasons: Sequence[str] = ()
    packages: tuple[str, ...] = ()
    samples = 0  # nothing is rendered

    def __init__(self, field: LightField, options: Options, clock: Clock) -> None:
        self._field, self._clock = field, clock
        self._pitch, self._delta = options.pitch, options.delta
        pixels_v, pixels_u, rows, cols, _ = field.views.shape
        self.lenses, self.pixels = (rows, cols), (pixels_v, pixels_u)
        self.sample: Pixels = field.views[0, 0, :1, :1]

    def start(self) -> None:
        """Everything is there already."""

    def notes(self) -> list[str]:
        """What a caller should hear of."""
        return [*self._field.notes]

    def lens_array(self) -> Report:
        """The report's `lens_array`; pitch and delta are null where nobody said them."""
        return _described(self.lenses, self.pixels, self._pitch, self._delta)

    def skipped(self) -> Report:
        """Nothing of what is mapped."""
        return {}

    def make(self, views: Sequence[View]) -> Iterator[NDArray[Any]]:
        """Each view, `(rows, cols, channels)`, in the light field's memory."""
        return (self._field.views[v, u] for v, u in views)

    def take(self, pictures: Iterator[NDArray[Any]], count: int) -> list[Pixels]:
        """The next `count` of `make`; those of an elemental image array are copied out of it."""
        with self._clock.stage("map"):
            return [np.ascontiguousarray(picture) for picture in islice(pictures, count)]


def _described(lenses: tuple[int, int], pixels: tuple[int, int], pitch: float | None, delta: float | None) -> Report:
    return {
        "rows": lenses[0],
        "cols": lenses[1],
        "pitch": pitch,
        "pixels_v": pixels[0],
        "pixels_u": pixels[1],
        "delta": delta,
    }
