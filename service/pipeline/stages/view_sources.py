"""View sources: views rendered from a mesh, or mapped from a light field, behind one interface."""

from __future__ import annotations

from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.backends.culling import cull_if_worthwhile
from ciir.renderer.readers.view_set.view_files import ViewFiles
from ciir.service.pipeline.limits import check_view_samples
from ciir.service.pipeline.stages import moved_array
from ciir.service.pipeline.stages.object_check import ObjectCheck

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View
    from ciir.service.pipeline.job import Job
    from ciir.service.pipeline.planning.plan import Plan
    from ciir.service.pipeline.report import Clock, Report


def open_source(job: Job, plan: Plan, clock: Clock) -> ViewSource:
    """Returns the view source for the content of `job`. Nothing is rendered yet.

    Raises `TooLarge` if a view of a mesh would take too many samples.
    """
    if job.mesh is not None:
        return MeshViews(job.mesh, job, plan, clock)
    return LightFieldViews(job.content, clock)  # type: ignore[arg-type]  # anything but a mesh is a light field


class MeshViews:
    """Renders a mesh to RGB, framed in front of the job's lens array. Raises `TooLarge` or `InvalidOption`."""

    def __init__(self, mesh: Scene, job: Job, plan: Plan, clock: Clock) -> None:
        self._mesh, self._job, self._plan, self._clock = mesh, job, plan, clock
        self._array = job.array.refine(plan.scale) if plan.strategy == "direct" else job.array
        check_view_samples(self._array, plan.samples, plan.strategy)
        side = job.samples if plan.moves_array else plan.samples
        self._rays = self._array.rows * self._array.cols * side**2
        moved = moved_array.count_samples(self._array, side) // moved_array.PICTURES
        self.samples = moved if plan.moves_array else self._rays
        """Points of the mesh that are sampled for each picture of `make_views`."""
        self.sample: Pixels = np.zeros((1, 1, 3), np.uint8)
        """A pixel, `(1, 1, C)`, with the channels and the depth of the views."""
        self._check, self._notes = ObjectCheck(job.background, hides_backs=mesh.hides_backs), set[str]()
        self._triangles_left = mesh.triangles

    def open(self) -> None:
        """Opens the backend and places the mesh. Raises `BackendUnavailable`."""
        with self._clock.stage("render"):
            from ciir.renderer.backends import open_backend

            self._backend, self._reason = open_backend(
                self._job.backend,
                triangles=self._mesh.triangles,
                rays=self._rays,
                is_see_through=self._mesh.is_see_through,
            )
            self._matrix = self._job.scene_transform
            self._placed = self._mesh.transform(self._matrix)

    def make_views(self, views: Sequence[View]) -> Iterator[NDArray[Any]]:
        """Renders each view, `(rows, cols, 3)` 8 bit, or `scale` times as large with the plan `direct`.

        If the plan moves the lens array, `views` are places in the grid of `moved_array.list_grid`.
        """
        if not self._plan.moves_array:
            return self._render(self._array, views, self._plan.samples)
        shown = list(dict.fromkeys(map(moved_array.find_view, views)))
        samples = moved_array.find_cell_side(self._job.samples)
        rendered = self._render(moved_array.refine_array(self._array), shown, samples)
        return moved_array.take_pictures(rendered, views, averages=self._job.samples > 1)

    def _render(self, array: LensArray, views: Sequence[View], samples: int) -> Iterator[NDArray[Any]]:
        scene = self._placed
        if self._job.skip:
            with self._clock.stage("render"):
                scene = cull_if_worthwhile(scene, array, views, self._backend.name, samples=samples)
                self._triangles_left = scene.triangles
        pictures = self._backend.render_views(
            scene, array, views, samples=samples, background=self._job.background, notes=self._notes
        )
        return map(self._drop_alpha, pictures)

    def take_views(self, pictures: Iterator[NDArray[Any]], count: int) -> list[Pixels]:
        """Takes the next `count` views of `make_views`, as contiguous arrays. Their time is counted."""
        with self._clock.stage("render"):
            return [np.ascontiguousarray(picture) for picture in islice(pictures, count)]

    def render_eia(self, progress: Progress) -> NDArray[np.uint8]:
        """Renders the elemental image array, `(rows*pixels_v, cols*pixels_u, 3)`. See `Backend.render_eia`."""
        with self._clock.stage("render"):
            eia = self._backend.render_eia(
                self._placed,
                self._array,
                samples=self._plan.samples,
                background=self._job.background,
                notes=self._notes,
                progress=progress,
            )
            return np.ascontiguousarray(self._drop_alpha(eia))

    def render_depth(self, array: LensArray, view: View) -> NDArray[np.float32]:
        """Renders the depth of a view of `array`, `(rows, cols)`, as `Backend.render_depth` does."""
        with self._clock.stage("render"):
            (depth,) = self._backend.render_depth(self._placed, array, [view])
            return depth

    def describe(self) -> Report:
        """Describes the views for the report."""
        return {
            "backend": self._backend.name,
            "transform": self._matrix.tolist(),
            "reasons": [self._reason],
            "skipped": {"culled": round(1 - self._triangles_left / self._mesh.triangles, 4)},
            "notes": [*self._mesh.notes, *sorted(self._notes), *self._check.list_notes()],
            "packages": ["embreex" if self._backend.name == "raytrace" else "pyrender"],
        }

    def _drop_alpha(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Drops the alpha of an RGBA picture, which is the share of a pixel that the object covers."""
        self._check.add(picture)
        return picture[..., :3]


class LightFieldViews:
    """Maps views out of a light field, pixel for pixel, with its channels and depth, or decodes them."""

    samples = 0

    def __init__(self, light_field: LightField | ViewFiles, clock: Clock) -> None:
        self._light_field, self._clock, self._taking = light_field, clock, Lock()
        self.sample: Pixels = np.zeros((1, 1, light_field.shape[4]), light_field.dtype)

    def open(self) -> None:
        """Does nothing: there is nothing to prepare."""

    def make_views(self, views: Sequence[View]) -> Iterator[Any]:
        """Returns the views to map."""
        return iter(views)

    def take_views(self, pictures: Iterator[Any], count: int) -> list[Pixels]:
        """Takes the next `count` views of `make_views`. Those of an elemental image array are copied out of it."""
        return self.fetch_views(list(islice(pictures, count)))

    def fetch_views(self, views: Sequence[View]) -> list[Pixels]:
        """Returns these views like `take_views`. Thread-safe."""
        if isinstance(self._light_field, ViewFiles):
            with self._clock.stage("decode"), self._taking:
                return self._light_field.take(views)
        with self._clock.stage("map"):
            return [np.ascontiguousarray(self._light_field.views[v, u]) for v, u in views]

    def describe(self) -> Report:
        """Describes the views for the report."""
        return {
            "backend": None,
            "transform": None,
            "reasons": [],
            "skipped": {},
            "notes": [*self._light_field.notes],
            "packages": [],
        }


ViewSource = MeshViews | LightFieldViews
