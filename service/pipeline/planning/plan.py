"""Plans a reconstruction before any view is made: the strategy, the model, and the reasons for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.errors import UnsupportedScale
from ciir.models import catalogue
from ciir.models.light_field.fusion.views import explain_no_fusion
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.service.pipeline.limits import MAX_VIEW_SAMPLES
from ciir.service.pipeline.options import AUTO, NO_MODEL, Options
from ciir.service.pipeline.planning.model_selection import select_model
from ciir.service.pipeline.planning.prediction import predict_times
from ciir.service.pipeline.stages.moved_array import find_cell_side

if TYPE_CHECKING:
    from ciir.models.catalogue import Entry
    from ciir.models.light_field.fusion import Fusion
    from ciir.service.pipeline.job import Job
    from ciir.service.pipeline.limits import Strategy


@dataclass(frozen=True)
class Plan:
    """How a job will be done."""

    strategy: Strategy
    """`upscale` upscales views with the model; `direct` renders a mesh at the larger size."""
    model: str
    """A name of the catalogue, or `none`."""
    scale: int
    """Output pixels for each view pixel, along each side."""
    samples: int
    """`samples x samples` points of a mesh are averaged for each pixel; 1 for a light field."""
    reasons: tuple[str, ...] = ()
    """Sentences for the report."""
    is_light_field: bool = False
    """Whether the model takes a view together with its neighbours."""
    restores_means: bool = False
    """Whether upscaled views are brought closer to the means that lenslets saw (`models.back_projection`)."""
    averages_misfits: bool = False
    """Whether pictures that a single-picture network makes badly become means with interpolation
    (`models.single.finishing`)."""
    finds_sampling: bool = False
    """Whether to find out if a light-field network's views are filtered or means (`models.sampling`)."""
    moves_array: bool = False
    """Whether a mesh's views are rendered through a lens array at several positions, in place of their neighbours."""
    fusion: Fusion = "never"
    """Which views are fused with the upscaled views around them (`models.light_field.fusion`)."""
    is_jpeg: bool = False
    """Whether the views are those of an elemental image array that is a JPEG."""
    notes: tuple[str, ...] = ()
    """Notes for the user on the selected model, and on options that change nothing."""


def note_scale(scale: int) -> tuple[str, ...]:
    """Returns a note if `scale` was given although no model upscales."""
    return () if scale in (1, Options.scale) else (f"scale: {scale} changes nothing with model none",)


def make_plan(job: Job) -> Plan:
    """Makes the plan for `job`. Raises `UnsupportedScale` if its model doesn't upscale by its scale."""
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
        notes = [*note_scale(job.scale), *_note_fusion(job, "model none")]
        return Plan(strategy, NO_MODEL, 1, job.samples, tuple(reasons), notes=tuple(notes))
    selected = select_model(job)
    model = catalogue.get_entry(selected.model)
    _check_scale(job, model)
    reasons += selected.reasons
    is_network = model.card is not None
    notes = [selected.note] if selected.note else []
    restores_means = job.sampling == "lenslet" and is_network and not job.is_transparent
    if restores_means:
        reasons.append("sampling lenslet: upscaled views are brought closer to the means that the lenses saw")
    elif job.sampling == "lenslet" and job.mesh is None:
        why = "views with transparency" if is_network else "interpolation"
        reasons.append(f"sampling lenslet: changes nothing in {why}")
        notes.append(reasons[-1])
    fusion = job.fusion if selected.is_light_field and job.mesh is None else "never"
    if fusion == "auto" and (why := explain_no_fusion(job.lenses[0] * job.lenses[1], job.arrangement.stride)):
        fusion = "never"
        reasons.append(f"fusion auto: no view is fused, as {why}")
    if fusion == "never":
        notes += _note_fusion(job, "a mesh" if job.mesh else f"{selected.model}, which upscales view by view")
    samples = WINDOW_SIDE * find_cell_side(job.samples) if selected.moves_array else job.samples
    return Plan(
        strategy,
        selected.model,
        job.scale,
        samples,
        tuple(reasons),
        selected.is_light_field,
        restores_means,
        job.model == AUTO and is_network and not selected.is_light_field,
        selected.is_light_field and job.mesh is None and job.sampling != "lenslet",
        selected.moves_array,
        fusion,
        job.is_jpeg,
        tuple(notes),
    )


def _note_fusion(job: Job, subject: str) -> list[str]:
    """Returns a note if the fusion of all views was asked for although `subject` has none."""
    return [f"fusion: always changes nothing with {subject}"] if job.fusion == "always" else []


def _check_scale(job: Job, model: Entry) -> None:
    """Raises `UnsupportedScale`, with a remedy for the kind of input, if `model` doesn't upscale by the scale."""
    if job.scale in model.scales:
        return
    given = f"scale: {model.name} upscales by {', '.join(map(str, model.scales))}, not {job.scale}"
    if job.scale == 1:
        raise UnsupportedScale(f"{given}; give model none for views that are not upscaled")
    if job.mesh is not None:
        raise UnsupportedScale(f"{given}; give strategy direct, which renders the mesh that large, or model bicubic")
    again = catalogue.advise_repeating(model, job.scale)
    raise UnsupportedScale(f"{given}; give a supported scale{again}, or model bicubic")


def _select_strategy(job: Job) -> tuple[Strategy, str]:
    """Selects the strategy for `auto`, and says why: of the possible ones, the one predicted to be faster."""
    mesh = job.mesh
    if job.model == NO_MODEL:
        return "upscale", "the model is none, so nothing is upscaled"
    if mesh is None:
        return "upscale", "the input holds pictures, so views are upscaled"
    selected = select_model(job)
    name = selected.model
    model = catalogue.get_entry(name)
    pixels = job.array.rows * job.array.cols
    rays: dict[Strategy, int] = {
        "upscale": pixels * job.samples**2,
        "direct": pixels * (job.scale * LENSLET_SAMPLES) ** 2,
    }
    limit = job.max_pixels
    if rays["direct"] > MAX_VIEW_SAMPLES or (
        limit is not None and rays["direct"] * len(job.wanted) * job.frames > limit
    ):
        return "upscale", f"upscale, as {rays['direct']:,} samples for each view at the larger size are over the limit"
    if job.scale not in model.scales:
        return "direct", f"direct, as {name} doesn't upscale by {job.scale}"
    if model.unsupported_reason:
        return "direct", f"direct, as {model.unsupported_reason}"
    predicted = predict_times(job, mesh, model, rays, moves_array=selected.moves_array)
    taken = min(predicted, key=predicted.__getitem__)
    (other,) = predicted.keys() - {taken}
    names = {"upscale": f"upscale by {name}", "direct": "direct"}
    times = f"{predicted[taken]:.1f} ms on a typical machine, {names[other]} {predicted[other]:.1f} ms"
    return taken, f"{names[taken]} should take {times}"
