"""Plans a reconstruction: the strategy and the model, and why, before any view is made."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import BackendUnavailable
from ciir.models import catalogue
from ciir.models.light_field.views import list_required_views
from ciir.renderer import backends
from ciir.renderer.framing import CLEARANCE, FILL
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.service.pipeline import cost
from ciir.service.pipeline.limits import MAX_VIEW_SAMPLES
from ciir.service.pipeline.model_selection import select_model
from ciir.service.pipeline.options import NO_MODEL
from ciir.service.pipeline.stages.schedule import batch_size

if TYPE_CHECKING:
    from ciir.models.cards import Card
    from ciir.models.catalogue import Entry
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.job import Job
    from ciir.service.pipeline.limits import Strategy


@dataclass(frozen=True)
class Plan:
    """How a job will be done."""

    strategy: Strategy
    """`upscale` views by the model, or render a mesh at the larger size (`direct`)."""
    model: str
    """A name of the catalogue, or `none`."""
    scale: int
    """Output pixels for each view pixel, along each side."""
    samples: int
    """`samples x samples` points of a mesh are averaged for each pixel; 1 for a light field."""
    reasons: tuple[str, ...] = ()
    """Sentences for the report."""
    is_light_field: bool = False
    """Whether the model takes a view with those around it."""
    note: str = ""
    """Why another model replaces the one that was named; empty where it doesn't."""


def make_plan(job: Job) -> Plan:
    """The plan for `job`."""
    reasons: list[str] = []
    strategy: Strategy = "direct" if job.strategy == "direct" else "upscale"
    if job.strategy == "auto":
        strategy, reason = _select_strategy(job)
        reasons.append(f"strategy auto: {reason}")
    if strategy == "direct":
        side = f"{LENSLET_SAMPLES}x{LENSLET_SAMPLES}"
        reasons.append(f"direct: each pixel is the mean of {side} rays over its own cell; no model ran")
        return Plan(strategy, NO_MODEL, job.scale, LENSLET_SAMPLES, tuple(reasons))
    if job.model == NO_MODEL:
        reasons.append("model none: views are written as they were made, pixel for pixel; scale doesn't apply")
        return Plan(strategy, NO_MODEL, 1, job.samples, tuple(reasons))
    selected = select_model(job)
    is_replaced = job.model not in ("auto", selected.model)
    return Plan(
        strategy,
        selected.model,
        job.scale,
        job.samples,
        (*reasons, *selected.reasons),
        selected.is_light_field,
        selected.reasons[-1] if is_replaced else "",
    )


def _select_strategy(job: Job) -> tuple[Strategy, str]:
    """The strategy that `auto` takes, and why: of those that are possible the one that is predicted to be faster.

    OpenGL is started only where the faster one would start it; where it does not work, rays are predicted instead.
    """
    mesh = job.mesh
    if job.model == NO_MODEL:
        return "upscale", "no model is wanted, so nothing is upscaled"
    if mesh is None:
        return "upscale", "the input holds pictures, so views are upscaled"
    name = select_model(job).model
    model = next(entry for entry in catalogue.list_entries() if entry.name == name)
    pixels = job.array.rows * job.array.cols
    rays: dict[Strategy, int] = {
        "upscale": pixels * job.samples**2,
        "direct": pixels * (job.scale * LENSLET_SAMPLES) ** 2,
    }
    limit = job.max_pixels
    if rays["direct"] > MAX_VIEW_SAMPLES or (limit is not None and rays["direct"] * len(job.wanted) > limit):
        return "upscale", f"upscale, as {rays['direct']:,} samples for each view at the larger size are over the limit"
    if job.scale not in model.scales:
        return "direct", f"direct, as {name} doesn't upscale by {job.scale}"
    if model.unsupported_reason:
        return "direct", f"direct, as {model.unsupported_reason}"
    predicted = _predict_times(job, mesh, model, rays)
    taken = min(predicted, key=predicted.__getitem__)
    backend = backends.predict_backend(job.backend, triangles=mesh.triangles, rays=rays[taken])
    if backend == "raster" and not backends.is_backend_open("raster"):
        with suppress(BackendUnavailable):  # `predict_backend` then takes rays
            backends.open_backend("raster")
        predicted = _predict_times(job, mesh, model, rays)
        taken = min(predicted, key=predicted.__getitem__)
    names = {"upscale": f"upscale by {name}", "direct": "direct"}
    (other,) = predicted.keys() - {taken}
    reason = f"{names[taken]} should take {predicted[taken]:.1f} ms here, {names[other]} {predicted[other]:.1f} ms"
    not_kept = cost.costs().not_kept
    return taken, reason + (f"; the measurements behind this could not be kept: {not_kept}" if not_kept else "")


def _predict_times(job: Job, mesh: Scene, model: Entry, rays: dict[Strategy, int]) -> dict[Strategy, float]:
    """Milliseconds from the mesh to encoded views for each strategy, with so many rays for each view."""
    costs, array, wanted = cost.costs(), job.array, len(job.wanted)
    pixels, textures = array.rows * array.cols, [(p.texture, len(p.faces)) for p in mesh.parts if p.texture]

    def render(strategy: Strategy, views: int) -> cost.Stage:
        rendering = cost.Rendering(
            backends.predict_backend(job.backend, triangles=mesh.triangles, rays=rays[strategy]),
            triangles=mesh.triangles,
            rays=rays[strategy],
            views=views,
            texels=sum(texture.pixels[..., 0].size for texture, _ in textures),
            textured=sum(triangles for _, triangles in textures) / mesh.triangles,
            culls=job.skip,
        )
        return costs.rendering(rendering)

    written = pixels * job.scale**2
    batches = math.ceil(wanted / batch_size(written))
    seen = round(pixels * _predict_share(mesh, array, model.card)) if model.card and job.skip else pixels
    upscaling = costs.upscaling(model.name, job.scale, pixels=seen, views=wanted, batches=batches)
    rendered = len(list_required_views(job.wanted, job.grid)) if model.is_light_field else wanted
    stages: dict[Strategy, list[cost.Stage]] = {
        "upscale": [render("upscale", rendered), upscaling],
        "direct": [render("direct", wanted)],
    }
    return {strategy: cost.total(of, wanted * written, batches) for strategy, of in stages.items()}


def _predict_share(mesh: Scene, array: LensArray, card: Card) -> float:
    """The share of a view's pixels that a network has to compute, roughly: the box around the framed object, the pixels
    that it changes, and those that they need.
    """
    low, high = mesh.bounds()
    sides, lenses = high - low, np.array([array.cols, array.rows])
    reach = np.array([np.abs(array.tangent_x()).max(), np.abs(array.tangent_y()).max()])
    middle = sides[2] / 2 + CLEARANCE * sides.max()  # its distance, as `frame_scene` places the object
    swept = sides[:2] + 2 * reach * middle
    scale = (FILL * lenses / np.maximum(swept, 1e-300)).min()
    return float(np.minimum(1.0, (scale * sides[:2] + 4 * card.radius) / lenses).prod())
