"""Which way to a mesh's enlarged views is the cheapest: a network on small ones, or rendering them as large."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

import numpy as np

from ciir.errors import BackendUnavailable
from ciir.models import catalogue
from ciir.models.light_field.views import needed
from ciir.models.session import available_cores
from ciir.renderer import backends
from ciir.renderer.framing import FILL, GAP
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.service.pipeline import cost
from ciir.service.pipeline.model_selection import choose
from ciir.service.pipeline.plan import MAX_VIEW_SAMPLES, mesh_array, samples
from ciir.service.pipeline.schedule import at_once

if TYPE_CHECKING:
    from ciir.models.card import Card
    from ciir.models.catalogue import Entry
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.model_selection import Choice, Job
    from ciir.service.pipeline.options import Options

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
    entry = _entry(model)
    if scale not in entry.scales:
        return f"{model} doesn't upscale by {scale}"
    return entry.unsuited


def _entry(model: str) -> Entry:
    return next(entry for entry in catalogue.entries() if entry.name == model)


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
    """Milliseconds from the mesh to encoded views; reading takes the same either way."""
    array, wanted = mesh_array(options), len(job.wanted)
    made = len(needed(job.wanted, job.grid)) if chosen.is_light_field else wanted
    pixels = array.rows * array.cols
    turns, cores = math.ceil(wanted / at_once(pixels * options.scale**2)), available_cores()

    def rendering(strategy: Strategy, views: int) -> cost.Stage:
        rays = _rays(options, strategy)
        backend = backends.expected(options.backend, triangles=mesh.triangles, rays=rays)
        return costs.rendering(backend, mesh, rays=rays, views=views, culls=options.skip == "exact")

    seen = _seen(mesh, array, _entry(chosen.model).card) if options.skip == "exact" else 1.0
    upscaling = costs.upscaling(chosen.model, options.scale, pixels=round(seen * pixels), views=wanted)
    encoding = costs.encoding(pixels=pixels * options.scale**2, views=wanted)
    return {
        "upscale": cost.together([rendering("upscale", made), upscaling, encoding], turns, cores),
        "direct": cost.together([rendering("direct", wanted), encoding], turns, cores),
    }


def _seen(mesh: Scene, array: LensArray, card: Card | None) -> float:
    """Share of a view's pixels that a network works on with exact skipping, roughly: in the box about the mesh, framed
    as `renderer.framing` does, what sees it and what that sees. 1 for interpolation.
    """
    if card is None:
        return 1.0
    low, high = mesh.bounds()
    width, height, depth = (high - low).tolist()
    distance = depth / 2 + GAP * max(width, height, depth)  # of the middle
    sweep_x = 2 * float(np.abs(array.tangent_x()).max()) * distance
    sweep_y = 2 * float(np.abs(array.tangent_y()).max()) * distance
    across, down = max(width + sweep_x, 1e-300), max(height + sweep_y, 1e-300)
    scale = FILL * min(array.width / across, array.height / down) / array.pitch
    cols, rows = scale * width + 4 * card.radius, scale * height + 4 * card.radius
    return float(min(1.0, cols / array.cols) * min(1.0, rows / array.rows))


def _starts_opengl(options: Options, strategy: Strategy, mesh: Scene) -> bool:
    """Whether `strategy` would start it."""
    name = backends.expected(options.backend, triangles=mesh.triangles, rays=_rays(options, strategy))
    return name == "raster" and not backends.is_open("raster")
