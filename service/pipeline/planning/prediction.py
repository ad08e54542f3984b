"""Predicts how long a job takes with each strategy and network."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ciir.models import catalogue
from ciir.models.light_field.fusion.views import list_block
from ciir.models.light_field.windows import list_required_views
from ciir.renderer import backends
from ciir.renderer.framing import CLEARANCE, FILL
from ciir.service.pipeline.options import NO_MODEL
from ciir.service.pipeline.planning import cost
from ciir.service.pipeline.stages.moved_array import count_cells, count_samples
from ciir.service.pipeline.stages.schedule import batch_size

if TYPE_CHECKING:
    from ciir.models.cards import Card
    from ciir.models.catalogue import Entry
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.placement import Placement
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.job import Job
    from ciir.service.pipeline.limits import Strategy
    from ciir.service.pipeline.planning.cost import Costs
    from ciir.service.pipeline.planning.plan import Plan

CUT_MS = 4e-5
"""Cost of each cell of a moved lens array, whose pictures are cut out of one rendering."""
FUSION_MS = 6e-4
"""Cost of each pixel of a view that is fused, besides the views around it."""
UNSURE = 3.0
"""Within this factor of a bound, typical costs don't decide; this machine is measured instead."""


def count_rendered(job: Job) -> int:
    """Counts the views of the lens array that a light-field network needs: the wanted ones and their neighbours."""
    return len(list_required_views(job.wanted, job.grid))


def predict_times(
    job: Job, mesh: Scene, model: Entry, rays: dict[Strategy, int], *, moves_array: bool
) -> dict[Strategy, float]:
    """Returns the milliseconds from the mesh to encoded views for each strategy, with `rays` rays for each view.

    `moves_array`: whether views are rendered through a moved lens array in place of their neighbours.
    """
    costs, wanted = cost.costs(), len(job.wanted)
    return {
        "upscale": _predict_with_model(job, mesh, model, rays["upscale"], costs=costs, moves_array=moves_array),
        "direct": _total(job, [_predict_rendering(job, mesh, rays["direct"], wanted, costs)], job.scale),
    }


def predict_plan(job: Job, plan: Plan) -> float:
    """Predicts the milliseconds from the opened input to encoded views, for all frames together.

    Nothing is measured for it: typical costs are used for anything not known about this machine. Views that turn out to
    look filtered, and are fused, are not foreseen.
    """
    costs, wanted, pixels = cost.costs(measure=False), job.wanted, job.array.rows * job.array.cols
    stages: list[cost.Stage] = []
    if job.mesh is not None:
        side = plan.samples * (plan.scale if plan.strategy == "direct" else 1)
        rays = pixels * (job.samples if plan.moves_array else side) ** 2
        rendered = count_rendered(job) if plan.is_light_field and not plan.moves_array else len(wanted)
        stages.append(_predict_rendering(job, job.mesh, rays, rendered, costs, moves_array=plan.moves_array))
    if plan.model != NO_MODEL:
        stage = _predict_upscaling(job, catalogue.get_entry(plan.model), costs)
        if plan.fusion == "always" or (plan.fusion == "auto" and plan.is_jpeg):
            upscaled = {other for view in wanted for other in list_block(view, job.grid)}
            ms = stage.views * len(upscaled) / len(wanted) + len(wanted) * pixels * FUSION_MS
            stage = stage._replace(views=ms)
        stages.append(stage)
    return _total(job, stages, plan.scale) * job.frames


def predict_extra(
    job: Job, mesh: Scene, light_field: Entry, single: Entry, *, moves_array: bool, bound: float
) -> float:
    """Predicts how many milliseconds more the views of `mesh` take with the network `light_field` than with `single`.

    That includes rendering the neighbouring views. Typical costs, which need no measurement, are used if they are
    certain to put the result over `bound` milliseconds, or under it.
    """
    rays = job.array.rows * job.array.cols * job.samples**2
    extra = 0.0
    for measure in (False, True):
        costs = cost.costs(measure=measure)
        taken = (
            _predict_with_model(job, mesh, model, rays, costs=costs, moves_array=moves_array)
            for model in (light_field, single)
        )
        extra = next(taken) - next(taken)
        if not bound / UNSURE < extra < bound * UNSURE:
            break
    return max(0.0, extra)


def _predict_with_model(job: Job, mesh: Scene, model: Entry, rays: int, *, costs: Costs, moves_array: bool) -> float:
    """Predicts the milliseconds of the job if `model` upscales its views."""
    moves_array = moves_array and model.is_light_field
    rendered = count_rendered(job) if model.is_light_field and not moves_array else len(job.wanted)
    rendering = _predict_rendering(job, mesh, rays, rendered, costs, moves_array=moves_array)
    return _total(job, [rendering, _predict_upscaling(job, model, costs)], job.scale)


def _predict_upscaling(job: Job, model: Entry, costs: Costs) -> cost.Stage:
    pixels = job.array.rows * job.array.cols
    if job.mesh is not None and model.card and job.skip:
        pixels = round(pixels * _predict_share(job.mesh, job.array, job.placement, model.card))
    batches = _count_batches(job, job.scale)
    return costs.upscaling(model.name, job.scale, pixels=pixels, views=len(job.wanted), batches=batches)


def _predict_rendering(
    job: Job, mesh: Scene, rays: int, views: int, costs: Costs, *, moves_array: bool = False
) -> cost.Stage:
    """Predicts the cost of `views` views of `rays` rays each.

    A moved lens array takes more rays, by the same backend, and its pictures are cut out of the rendering.
    """
    textures = [(part.texture, len(part.faces)) for part in mesh.parts if part.texture]
    stage = costs.rendering(
        cost.Rendering(
            backends.predict_backend(
                job.backend, triangles=mesh.triangles, rays=rays, is_see_through=mesh.is_see_through
            ),
            triangles=mesh.triangles,
            rays=count_samples(job.array, job.samples) if moves_array else rays,
            views=views,
            texels=sum(texture.pixels[..., 0].size for texture, _ in textures),
            textured=sum(triangles for _, triangles in textures) / mesh.triangles,
            culls=job.skip,
        )
    )
    return stage._replace(views=stage.views + views * count_cells(job.array) * CUT_MS) if moves_array else stage


def _total(job: Job, stages: list[cost.Stage], scale: int) -> float:
    """Returns the milliseconds of the job, given its stages before views are written."""
    written = len(job.wanted) * job.array.rows * job.array.cols * scale**2
    return cost.total(stages, written, _count_batches(job, scale))


def _count_batches(job: Job, scale: int) -> int:
    return math.ceil(len(job.wanted) / batch_size(job.array.rows * job.array.cols * scale**2))


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
