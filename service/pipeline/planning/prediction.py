"""Predicts how long rendering and upscaling take with each strategy and network, for `auto`.

The model is fixed: milliseconds on two cores of an EPYC with int8 instructions and OpenGL by Mesa, once everything has
started. Nothing is measured, and nothing counts that differs from one machine to the next, such as cores, instructions,
load, and whether OpenGL works. So a job is done in the same way everywhere. Reading and writing, which take the same
time in all ways, are left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.windows import list_required_views
from ciir.renderer import backends
from ciir.renderer.backends import culling
from ciir.renderer.framing import CLEARANCE, FILL
from ciir.service.pipeline.stages.moved_array import count_cells, count_samples

if TYPE_CHECKING:
    from ciir.models.cards import Card
    from ciir.models.catalogue import Entry
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.placement import Placement
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.job import Job
    from ciir.service.pipeline.limits import Strategy

MAC_MS = 2.5e-9
"""Cost of a network's multiply-add in int8. In float it takes about twice as long, which doesn't count, because `auto`
takes float networks only where a processor has no int8 instructions."""
INTERPOLATION_MS = 1e-4
"""Cost of interpolating an input pixel."""
CUT_MS = 4e-5
"""Cost of each cell of a moved lens array, whose pictures are cut out of one rendering."""
PLACE_MS, LOOK_MS, HIT = 4e-5, 1.3e-5, 1.25
"""Culling: cost for each triangle, and for each triangle in each view; triangles that remain for each ray."""


def count_rendered(job: Job) -> int:
    """Counts the views of the lens array that a light-field network needs: the wanted ones and their neighbours."""
    return len(list_required_views(job.wanted, job.grid))


def predict_times(
    job: Job, mesh: Scene, model: Entry, rays: dict[Strategy, int], *, moves_array: bool
) -> dict[Strategy, float]:
    """Returns the milliseconds of each strategy, with `rays` rays for each view.

    `moves_array`: whether views are rendered through a moved lens array in place of their neighbours.
    """
    return {
        "upscale": _predict_with_model(job, mesh, model, rays["upscale"], moves_array=moves_array),
        "direct": _predict_rendering(job, mesh, rays["direct"], len(job.wanted)),
    }


def predict_extra(job: Job, mesh: Scene, light_field: Entry, single: Entry, *, moves_array: bool) -> float:
    """Predicts how many milliseconds more the views of `mesh` take with the network `light_field` than with `single`.

    That includes rendering the neighbouring views.
    """
    rays = job.array.rows * job.array.cols * job.samples**2
    taken = _predict_with_model(job, mesh, light_field, rays, moves_array=moves_array)
    return max(0.0, taken - _predict_with_model(job, mesh, single, rays, moves_array=False))


def _predict_with_model(job: Job, mesh: Scene, model: Entry, rays: int, *, moves_array: bool) -> float:
    """Predicts the milliseconds of the job if `model` upscales its views."""
    views = count_rendered(job) if model.is_light_field and not moves_array else len(job.wanted)
    upscaled = len(job.wanted) * _predict_upscaling(job, mesh, model)
    return _predict_rendering(job, mesh, rays, views, moves_array=moves_array) + upscaled


def _predict_upscaling(job: Job, mesh: Scene, model: Entry) -> float:
    """Predicts the milliseconds of one view."""
    pixels = job.array.rows * job.array.cols
    if model.card is None:
        return pixels * INTERPOLATION_MS
    share = _predict_share(mesh, job.array, job.placement, model.card) if job.skip else 1.0
    return share * pixels * job.scale**2 * model.card.macs_per_output_pixel * MAC_MS


def _predict_rendering(job: Job, mesh: Scene, rays: int, views: int, *, moves_array: bool = False) -> float:
    """Predicts the milliseconds of `views` views of `rays` rays each.

    They are linear in triangles and texels, which are prepared once, and for each view in rays, which cost more on
    textured triangles, and with OpenGL in triangles. A moved lens array takes more rays, by the same backend, and its
    pictures are cut out of the rendering.
    """
    triangles, ms = mesh.triangles, 0.0
    backend = backends.predict_backend(job.backend, triangles=triangles, rays=rays, is_see_through=mesh.is_see_through)
    if moves_array:
        rays = count_samples(job.array, job.samples)
        ms += views * count_cells(job.array) * CUT_MS
    if job.skip and culling.is_worthwhile(backend, triangles=triangles, rays=rays, views=views):
        ms += triangles * (PLACE_MS + views * LOOK_MS)
        triangles = min(triangles, round(HIT * views * rays))
    textures = [(part.texture, len(part.faces)) for part in mesh.parts if part.texture]
    textured = sum(faces for _, faces in textures) / mesh.triangles
    if backend == "raytrace":
        return ms + 0.28 + 3.3e-4 * triangles + views * (0.046 + rays * (8.4e-5 + 8.8e-5 * textured))
    texels = sum(texture.pixels[..., 0].size for texture, _ in textures)
    once = 1.0 + 9e-6 * triangles + 1e-5 * texels
    return ms + once + views * (0.14 + 1.1e-4 * triangles + rays * (2.2e-5 + 7e-6 * textured))


def _predict_share(mesh: Scene, array: LensArray, placement: Placement, card: Card) -> float:
    """Estimates the share of a view's pixels that a network has to compute.

    These are the pixels in the box around the framed object, the pixels that it changes, and those that they need.
    """
    sides = np.abs(placement.rotation()) @ np.ptp(mesh.bounds(), axis=0)  # sides of the rotated box
    lenses = np.array([array.cols, array.rows])
    reach = np.array([np.abs(array.tangent_x()).max(), np.abs(array.tangent_y()).max()])
    middle = abs(placement.place) * (sides[2] / 2 + CLEARANCE * sides.max())  # its distance, as in `frame_scene`
    swept = sides[:2] + 2 * reach * middle
    fitted = 1 / array.pitch if placement.fit == "none" else (FILL * lenses / np.maximum(swept, 1e-300)).min()
    scale = placement.zoom * fitted
    return float(np.minimum(1.0, (scale * sides[:2] + 4 * card.radius) / lenses).prod())
