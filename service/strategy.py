"""Which way to a mesh's enlarged views is the cheapest: a network on small ones, or rendering them as large."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Literal

from models import catalogue
from models.views import needed
from renderer import backends
from renderer.errors import BackendUnavailable
from renderer.sampling import LENSLET_SAMPLES
from service import cost
from service.choice import choose
from service.plan import MAX_VIEW_SAMPLES, mesh_array, samples

if TYPE_CHECKING:
    from renderer.scene import Scene
    from service.choice import Choice, Job
    from service.request import Options

Strategy = Literal["upscale", "direct"]


def cheapest(options: Options, job: Job, mesh: Scene, limit: int | None) -> tuple[Strategy, str]:
    """The quicker strategy for the mesh of `job`, and why, with the milliseconds that were predicted for each.

    What can't be done is none: `direct` with more samples than `MAX_VIEW_SAMPLES` a view or `limit` in all, `upscale`
    by a model that doesn't take the scale or the processor. OpenGL is started only where the quicker one would start
    it; where it turns out not to work, rays are what is predicted.
    """
    costs, chosen = cost.costs(), choose(options, job)
    against = {"upscale": _against_model(chosen.model, options.scale), "direct": _against_size(options, job, limit)}
    possible: list[Strategy] = [name for name in ("upscale", "direct") if not against[name]]
    if len(possible) < 2:
        only: Strategy = possible[0] if possible else "upscale"
        return only, f"{only}, as {against['upscale'] or against['direct']}"
    predicted = _predicted(costs, options, job, chosen, mesh)
    if _starts_opengl(options, min(predicted, key=predicted.__getitem__), mesh):
        with suppress(BackendUnavailable):  # `backends.expected` knows from now on, and the report's reasons say so
            backends.open_backend("raster")
        predicted = _predicted(costs, options, job, chosen, mesh)
    taken = min(predicted, key=predicted.__getitem__)
    said = {"upscale": f"upscale by {chosen.model}", "direct": "direct"}
    (other,) = predicted.keys() - {taken}
    reason = f"{said[taken]} is to take {predicted[taken]:.1f} ms here, {said[other]} {predicted[other]:.1f} ms"
    return taken, reason + (f"; what was measured for it is not kept, as {costs.trouble}" if costs.trouble else "")


def _against_model(model: str, scale: int) -> str:
    """Why views can't be upscaled; empty where they can."""
    entry = next(entry for entry in catalogue.entries() if entry.name == model)
    if scale not in entry.scales:
        return f"{model} doesn't upscale by {scale}"
    return entry.unsuited


def _against_size(options: Options, job: Job, limit: int | None) -> str:
    """Why views can't be rendered at the larger size; empty where they can."""
    rays = _rays(options, "direct")
    if rays > MAX_VIEW_SAMPLES or (limit is not None and rays * len(job.wanted) > limit):
        return f"{rays:,} samples for each view at the larger size are over the limit"
    return ""


def _rays(options: Options, strategy: Strategy) -> int:
    """Points of the mesh that are sampled for a view."""
    array = mesh_array(options)
    each = options.scale * LENSLET_SAMPLES if strategy == "direct" else samples(options)
    return array.rows * array.cols * each**2


def _predicted(costs: cost.Costs, options: Options, job: Job, chosen: Choice, mesh: Scene) -> dict[Strategy, float]:
    """Milliseconds of rendering and upscaling; reading and encoding take the same either way."""
    array, wanted = mesh_array(options), len(job.wanted)
    made = len(needed(job.wanted, job.grid)) if chosen.is_light_field else wanted

    def rendering(strategy: Strategy, views: int) -> float:
        rays = _rays(options, strategy)
        backend = backends.expected(options.backend, triangles=mesh.triangles, rays=rays)
        return costs.rendering(backend, mesh, rays=rays, views=views)

    upscaling = costs.upscaling(chosen.model, options.scale, pixels=array.rows * array.cols, views=wanted)
    return {"upscale": rendering("upscale", made) + upscaling, "direct": rendering("direct", wanted)}


def _starts_opengl(options: Options, strategy: Strategy, mesh: Scene) -> bool:
    """Whether `strategy` would start it."""
    name = backends.expected(options.backend, triangles=mesh.triangles, rays=_rays(options, strategy))
    return name == "raster" and not backends.is_open("raster")
