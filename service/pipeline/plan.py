"""How a reconstruction will be done, and why: decided before any view is made, and told in the report."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ciir.errors import BackendUnavailable, InvalidOption, TooLarge
from ciir.models import catalogue
from ciir.models.catalogue import DEFAULT
from ciir.models.light_field.views import list_required_views
from ciir.renderer import backends
from ciir.renderer.framing import CLEARANCE, FILL
from ciir.renderer.lens_array import LensArray
from ciir.renderer.readers.pictures import MAX_SIDE
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.service.pipeline import cost
from ciir.service.pipeline.model_selection import check_model, choose
from ciir.service.pipeline.options import NO_MODEL
from ciir.service.pipeline.schedule import at_once

if TYPE_CHECKING:
    from ciir.models.cards import Card
    from ciir.models.catalogue import Entry
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.model_selection import Job
    from ciir.service.pipeline.options import Options

Strategy = Literal["upscale", "direct"]
MAX_VIEW_PIXELS = 64_000_000
"""Most pixels in one view, in or out: as many as a picture may have that is read."""
LENSES = (100, 100)
PIXELS = (15, 15)
"""What a mesh is seen through where nothing is said."""
MAX_VIEW_SAMPLES = 64_000_000
"""Most points of a mesh that are sampled for one view: memory grows with them, by about 10 bytes each."""
REMEDY = {"upscale": "pinhole sampling", "direct": "a smaller scale or strategy upscale"}
"""What leaves a mesh fewer samples, beside fewer lenses."""
_MESH_ONLY: tuple[tuple[str, object], ...] = (("backend", "auto"), ("sampling", "pinhole"), ("background", (0, 0, 0)))


@dataclass(frozen=True)
class Plan:
    """What will be done."""

    strategy: Strategy
    model: str
    """A name of the catalogue, or `none`."""
    enlarge: int
    """View pixels are made `enlarge` times as many along each side, by the model or by the renderer."""
    samples: int
    """`samples x samples` points of a mesh are averaged for each pixel; 1 for a picture."""
    reasons: tuple[str, ...]
    is_light_field: bool = False
    """Whether the model takes a view with those around it."""


def samples(options: Options) -> int:
    """Samples along each side of a lens's cell for `options.sampling`."""
    return LENSLET_SAMPLES if options.sampling == "lenslet" else 1


def make(options: Options, job: Job, *, mesh: Scene | None = None, limit: int | None = None) -> Plan:
    """The plan for `job`, with its mesh where it is one; all views together may have `limit` samples of that.

    Raises `InvalidOption` where an option doesn't fit the kind of input, `UnknownModel` where the model isn't there.
    """
    reasons = []
    if job.is_mesh and options.pickup != "virtual":
        raise InvalidOption(f"pickup: optical is for elemental image arrays and {job.name} is a mesh; leave it out")
    if not job.is_mesh:
        for option, default in _MESH_ONLY:
            if getattr(options, option) != default:
                raise InvalidOption(f"{option}: this is for meshes and {job.name} holds pictures; leave it out")
        if options.strategy == "direct":
            raise InvalidOption(f"strategy: direct renders a mesh and {job.name} holds pictures; give upscale or auto")
    check_model(options.model)
    strategy: Strategy = "direct" if options.strategy == "direct" else "upscale"
    if options.strategy == "auto":
        strategy, reason = _select_strategy(options, job, mesh, limit)
        reasons.append(f"strategy auto: {reason}")
    if strategy == "direct":
        reasons.append(
            f"direct: each pixel is the mean of {LENSLET_SAMPLES}x{LENSLET_SAMPLES} rays over its own cell; "
            "no model ran, and sampling doesn't apply"
        )
        return Plan(strategy, NO_MODEL, options.scale, LENSLET_SAMPLES, tuple(reasons))
    enlarge = options.scale
    if options.model == NO_MODEL:
        enlarge = 1
        reasons.append("model none: views are written as they were made, pixel for pixel; scale doesn't apply")
    chosen = choose(options, job)
    return Plan(
        strategy,
        chosen.model,
        enlarge,
        samples(options) if job.is_mesh else 1,
        (*reasons, *chosen.reasons),
        chosen.is_light_field,
    )


def _select_strategy(options: Options, job: Job, mesh: Scene | None, limit: int | None) -> tuple[Strategy, str]:
    """The strategy that `auto` takes, and why: of those that are possible the one that is predicted to be faster.

    OpenGL is started only where the faster one would start it; where it does not work, rays are predicted instead.
    """
    if options.model == NO_MODEL:
        return "upscale", "no model is wanted, so nothing is enlarged"
    if mesh is None:
        return "upscale", "the input holds pictures, so views are upscaled"
    array, name = mesh_array(options), choose(options, job).model
    model = next(entry for entry in catalogue.list_entries() if entry.name == name)
    pixels = array.rows * array.cols
    rays: dict[Strategy, int] = {
        "upscale": pixels * samples(options) ** 2,
        "direct": pixels * (options.scale * LENSLET_SAMPLES) ** 2,
    }
    if rays["direct"] > MAX_VIEW_SAMPLES or (limit is not None and rays["direct"] * len(job.wanted) > limit):
        return "upscale", f"upscale, as {rays['direct']:,} samples for each view at the larger size are over the limit"
    if options.scale not in model.scales:
        return "direct", f"direct, as {name} doesn't upscale by {options.scale}"
    if model.unsupported_reason:
        return "direct", f"direct, as {model.unsupported_reason}"
    predicted = _predict(options, job, mesh, model, rays)
    taken = min(predicted, key=predicted.__getitem__)
    backend = backends.predict_backend(options.backend, triangles=mesh.triangles, rays=rays[taken])
    if backend == "raster" and not backends.is_backend_open("raster"):
        with suppress(BackendUnavailable):  # `backends.predict_backend` then takes rays
            backends.open_backend("raster")
        predicted = _predict(options, job, mesh, model, rays)
        taken = min(predicted, key=predicted.__getitem__)
    names = {"upscale": f"upscale by {name}", "direct": "direct"}
    (other,) = predicted.keys() - {taken}
    reason = f"{names[taken]} should take {predicted[taken]:.1f} ms here, {names[other]} {predicted[other]:.1f} ms"
    not_kept = cost.costs().not_kept
    return taken, reason + (f"; the measurements behind this could not be kept: {not_kept}" if not_kept else "")


def _predict(options: Options, job: Job, mesh: Scene, model: Entry, rays: dict[Strategy, int]) -> dict[Strategy, float]:
    """Milliseconds from the mesh to encoded views for each strategy, with so many rays for each view."""
    costs, array, wanted = cost.costs(), mesh_array(options), len(job.wanted)
    pixels, textures = array.rows * array.cols, [(p.texture, len(p.faces)) for p in mesh.parts if p.texture]

    def render(strategy: Strategy, views: int) -> cost.Stage:
        rendering = cost.Rendering(
            backends.predict_backend(options.backend, triangles=mesh.triangles, rays=rays[strategy]),
            triangles=mesh.triangles,
            rays=rays[strategy],
            views=views,
            texels=sum(texture.pixels[..., 0].size for texture, _ in textures),
            textured=sum(triangles for _, triangles in textures) / mesh.triangles,
            culls=options.skip == "exact",
        )
        return costs.rendering(rendering)

    written = pixels * options.scale**2
    batches = math.ceil(wanted / at_once(written))
    seen = round(pixels * _seen(mesh, array, model.card)) if model.card and options.skip == "exact" else pixels
    upscaling = costs.upscaling(model.name, options.scale, pixels=seen, views=wanted, batches=batches)
    made = len(list_required_views(job.wanted, job.grid)) if model.is_light_field else wanted
    stages: dict[Strategy, list[cost.Stage]] = {
        "upscale": [render("upscale", made), upscaling],
        "direct": [render("direct", wanted)],
    }
    return {strategy: cost.total(of, wanted * written, batches) for strategy, of in stages.items()}


def _seen(mesh: Scene, array: LensArray, card: Card) -> float:
    """Share of a view that a network works on with exact skipping, roughly: the box about the framed object, what its
    pixels change and what those need.
    """
    low, high = mesh.bounds()
    sides, lenses = high - low, np.array([array.cols, array.rows])
    reach = np.array([np.abs(array.tangent_x()).max(), np.abs(array.tangent_y()).max()])
    swept = sides[:2] + 2 * reach * (
        sides[2] / 2 + CLEARANCE * sides.max()
    )  # by the middle, as `frame_scene` places it
    scale = (FILL * lenses / np.maximum(swept, 1e-300)).min()
    return float(np.minimum(1.0, (scale * sides[:2] + 4 * card.radius) / lenses).prod())


def mesh_array(options: Options) -> LensArray:
    """The lens array in front of a mesh; what isn't said is 100x100 lenses of 15x15 pixels with a pitch of 1."""
    rows, cols = options.lenses or LENSES
    pixels_v, pixels_u = options.pixels or PIXELS
    pitch = 1.0 if options.pitch is None else options.pitch
    delta = 0.0 if options.delta is None else options.delta
    return LensArray(rows, cols, pixels_v, pixels_u, pitch, delta)


def check_views(spec: str, pixels: tuple[int, int], limit: int) -> None:
    """Raises `TooLarge` where `spec`, which holds `;` between the views that it names, asks for more than `limit`."""
    if spec == "all" and pixels[0] * pixels[1] > limit:
        raise TooLarge(
            f"views: all of {pixels[0]}x{pixels[1]} are over the limit of {limit:,}; name some, or fewer pixels"
        )
    if spec.count(";") >= limit + spec.endswith(";"):
        raise TooLarge(f"views: {spec.count(';') + 1:,} are over the limit of {limit:,}; name fewer")


def check_size(rows: int, cols: int, enlarge: int, count: int, limit: int | None, *, what: str = "a view") -> None:
    """Raises `TooLarge` where a view, or all `count` of them together with a `limit`, would have too many pixels."""
    pixels = rows * cols * enlarge**2
    if pixels > MAX_VIEW_PIXELS or max(rows, cols) * enlarge > MAX_SIDE:
        raise TooLarge(
            f"{what}: {rows * enlarge}x{cols * enlarge} pixels are over the limit of {MAX_VIEW_PIXELS:,}, or of "
            f"{MAX_SIDE:,} a side; give a smaller scale or a smaller input"
        )
    if limit is not None and count * pixels > limit:
        raise TooLarge(
            f"{count} views of {rows * enlarge}x{cols * enlarge} are {count * pixels:,} pixels, over the limit of "
            f"{limit:,}; ask for fewer views, fewer lenses or a smaller scale"
        )


def check_samples(array: LensArray, samples: int, strategy: Strategy = "upscale") -> int:
    """Points of a mesh in a view of `array` with `samples x samples` a pixel; raises `TooLarge` for too many."""
    points = array.rows * array.cols * samples**2
    if points > MAX_VIEW_SAMPLES:
        raise TooLarge(
            f"a view of {array.rows}x{array.cols} pixels with {samples}x{samples} samples each is {points:,} samples, "
            f"over the limit of {MAX_VIEW_SAMPLES:,}; give fewer lenses or {REMEDY[strategy]}"
        )
    return points


def check_work(
    samples: int, count: int, limit: int | None, strategy: Strategy = "upscale", *, further: int = 0
) -> None:
    """Raises `TooLarge` where `count` views of `samples` points of a mesh each are over `limit`, where there is one.

    `further`: how many of them only help others.
    """
    if limit is not None and count * samples > limit:
        helpers = f", {further} of them around those asked for," if further else ""
        raise TooLarge(
            f"{count} views of {samples:,} samples each{helpers} are {count * samples:,}, over the limit of {limit:,}; "
            f"ask for fewer views, fewer lenses{f', model {DEFAULT}' if further else ''} or {REMEDY[strategy]}"
        )


def check_eia(options: Options) -> None:
    """Raises `TooLarge` where a mesh's elemental image array would have more pixels than a picture may have."""
    array = mesh_array(options)
    height, width = array.rows * array.pixels_v, array.cols * array.pixels_u
    if height * width > MAX_VIEW_PIXELS or max(height, width) > MAX_SIDE:
        raise TooLarge(
            f"an elemental image array of {height}x{width} pixels is over the limit of {MAX_VIEW_PIXELS:,}, or of "
            f"{MAX_SIDE:,} a side; give fewer lenses or fewer pixels"
        )
