"""Selects the model that upscales the views: the one that was named, or the one that suits them best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.models import catalogue, processor
from ciir.models.light_field.windows import MINIMUM_GRID, WINDOW_SIDE
from ciir.service.pipeline.options import AUTO, NO_MODEL
from ciir.service.pipeline.planning.prediction import count_rendered, predict_extra
from ciir.service.pipeline.stages.moved_array import count_samples, is_possible

if TYPE_CHECKING:
    from ciir.models.catalogue import Entry
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.job import Job


@dataclass(frozen=True)
class Selection:
    """A model, and why it was selected."""

    model: str
    """A name of the catalogue, or `none`."""
    is_light_field: bool = False
    """Whether it takes a view together with its neighbours."""
    moves_array: bool = False
    """Whether a mesh's views are rendered through a lens array at several positions, in place of their neighbours."""
    reasons: tuple[str, ...] = ()
    """Sentences for the report."""
    note: str = ""
    """A note for the user; empty if there is none."""


def select_model(job: Job) -> Selection:
    """Selects the model for `job`.

    `auto` takes the default light-field network, which is more accurate on all grids that it takes (docs/accuracy.md).
    If there is a reason against it, `auto` takes the default single-picture network. Both are int8 networks if the
    processor supports them. For a light-field network a mesh is rendered through a lens array that is moved
    (`service.pipeline.stages.moved_array`), or else the neighbouring views are rendered: `auto` does the first of these
    that is predicted to make the job, or each frame of a video, at most `job.neighbour_time` longer on a typical
    machine. If views can't help each other, the default single-picture network replaces a light-field network.
    """
    if job.model == NO_MODEL:
        return Selection(NO_MODEL)
    networks = {entry.name: entry for entry in catalogue.list_entries()}
    if job.model == AUTO:
        return _select_automatically(job, networks)
    if not networks[job.model].is_light_field:
        return Selection(job.model)
    return _select_light_field(job, networks)


def _select_light_field(job: Job, networks: dict[str, Entry]) -> Selection:
    """Selects the light-field network that was named, or a single-picture network if views can't help each other."""
    default = catalogue.picture_default_name()
    if reason := _no_light_field(job):
        return _replace_model(job, default, reason)
    if job.mesh is None:
        spaced = _describe_stride(job)
        reasons = (f"{job.model}: {spaced}",) if spaced else ()
        return Selection(job.model, True, reasons=reasons, note=_describe_wrong_order(job))
    moves_array, rendered = _judge_moving(job, job.mesh, networks[job.model], networks[default])
    if not moves_array and (reason := _too_few_views(job)):
        return _replace_model(job, default, reason)
    neighbours = count_rendered(job) - len(job.wanted)
    if not moves_array and neighbours:
        rendered = f": views around those asked for are rendered too, {neighbours} of them"
    return Selection(job.model, True, moves_array, (f"{job.model}{rendered}",) if rendered else ())


def _replace_model(job: Job, default: str, reason: str) -> Selection:
    replaced = f"{default}, view by view, in place of {job.model}, as {reason}"
    return Selection(default, reasons=(replaced,), note=replaced)


def _select_automatically(job: Job, networks: dict[str, Entry]) -> Selection:
    """Selects the model for `auto` from the installed `networks`, by name."""
    default, light_field = catalogue.picture_default_name(), catalogue.light_field_default_name()
    reason, rendered = _reason_against(light_field, networks.get(light_field), job), ""
    moves_array = False
    if not reason and job.mesh is not None:
        compared = networks[light_field], networks[default]
        moves_array, rendered = _judge_moving(job, job.mesh, *compared)
        if not moves_array:
            reason, rendered = _judge_neighbours(job, job.mesh, *compared)
    if reason:
        precision = _describe_precision(networks[default])
        return Selection(default, reasons=(f"model auto: {default}, view by view, as {reason}{precision}",))
    precision = _describe_precision(networks[light_field])
    spaced = _describe_stride(job)
    rendered += f"; {spaced}" if spaced else ""
    several = "pictures of each view" if moves_array else _views(job)
    why = f"model auto: {light_field}, as {several} help each other{rendered}{precision}"
    return Selection(light_field, True, moves_array, (why,), _describe_wrong_order(job))


def _describe_precision(network: Entry) -> str:
    """Says why `auto` takes `network` in its precision."""
    if network.card is not None and network.card.precision == "int8":
        return "; in int8, which this processor supports"
    against = processor.int8_unsupported_reason()
    return f"; in float, as {against}" if against else ""


def _describe_stride(job: Job) -> str:
    """Says which views of a light field help each other, if they are not the nearest."""
    if job.mesh is not None or job.arrangement.stride == 1:
        return ""
    return f"views {job.arrangement.stride} apart are used, as content moves little from one to the next"


def _views(job: Job) -> str:
    return f"the {job.grid[0]}x{job.grid[1]} views"


def _no_light_field(job: Job) -> str:
    """Says why the views of `job` can't help each other; empty if they can."""
    if job.is_transparent:
        return "views with transparency can't help each other"
    return "" if job.mesh is not None else _too_few_views(job)


def _too_few_views(job: Job) -> str:
    """Says why the views of `job` are too few to help each other, but for a mesh's through a moved lens array."""
    if min(job.grid) >= MINIMUM_GRID:
        return ""
    return f"{_views(job)} are fewer than the {MINIMUM_GRID}x{MINIMUM_GRID} that a light-field network needs"


def _describe_wrong_order(job: Job) -> str:
    """Returns the note on views that are certainly in a wrong order, all or some of them; empty if they are not."""
    order = job.order
    if order is None or not order.is_wrong:
        return "" if order is None else order.describe_contradiction()
    return (
        f"order: the views seem to be {order}, which fits {order.votes} of {order.of} textured tiles: each view is "
        "upscaled with its neighbours in the right order, and written where it was; if the order is right, give order "
        "given (in Python is_ordered=True)"
    )


def _judge_moving(job: Job, mesh: Scene, light_field: Entry, single: Entry) -> tuple[bool, str]:
    """Returns whether views of `mesh` are rendered through a moved lens array for `light_field`, and what that costs.

    Nothing is predicted for a network that can't run; its error names the remedy later.
    """
    can_run = job.scale in light_field.scales and not light_field.unsupported_reason
    bound = 1000 * job.neighbour_time
    samples = count_samples(job.array, job.samples) * len(job.wanted) * job.frames
    is_over = job.max_pixels is not None and samples > job.max_pixels
    if not can_run or not bound or is_over or not is_possible(job.array, job.samples):
        return False, ""
    extra = predict_extra(job, mesh, light_field, single, moves_array=True)
    if extra > bound:
        return False, ""
    rendered = f"; each view is rendered through the lens array at {WINDOW_SIDE}x{WINDOW_SIDE} positions"
    return True, f"{rendered}: {_compare(job, extra, single, bound)}"


def _judge_neighbours(job: Job, mesh: Scene, light_field: Entry, single: Entry) -> tuple[str, str]:
    """Returns why the neighbours of the wanted views of `mesh` are not rendered for `light_field`, and what they cost.

    The reason is empty if they are rendered; the cost is empty if there are no neighbours.
    """
    if reason := _too_few_views(job):
        return reason, ""
    neighbours = count_rendered(job) - len(job.wanted)
    if not neighbours:
        return "", ""
    if over := _count_excess(job, neighbours):
        return f"{light_field.name} would need {neighbours} more views rendered, {over:,} samples over the limit", ""
    bound = 1000 * job.neighbour_time
    if not bound:
        return f"{light_field.name} would need {neighbours} more views rendered, and neighbour_time 0 allows none", ""
    extra = predict_extra(job, mesh, light_field, single, moves_array=False)
    times = _compare(job, extra, single, bound)
    if extra > bound:
        return f"{light_field.name} would need {neighbours} more views rendered around those asked for: {times}", ""
    return "", f"; {neighbours} more are rendered around those asked for: {times}"


def _compare(job: Job, extra: float, single: Entry, bound: float) -> str:
    each = "" if job.frames == 1 else " for each frame"
    times = f"about {extra:.0f} ms more than {single.name} alone{each} on a typical machine"
    return f"{times}, and neighbour_time allows {bound:.0f} ms"


def _count_excess(job: Job, neighbours: int) -> int:
    """Returns by how many samples the wanted views and `neighbours` more exceed the job's limit; 0 if they don't."""
    samples = (len(job.wanted) + neighbours) * job.array.rows * job.array.cols * job.samples**2
    return 0 if job.max_pixels is None else max(0, samples - job.max_pixels)


def _reason_against(name: str, network: Entry | None, job: Job) -> str:
    """Says why `auto` doesn't take `network`, the light-field model `name`, for these views; empty if it can."""
    if network is None:
        return f"{name} is not installed"
    if reason := _no_light_field(job):
        return reason
    if job.scale not in network.scales:
        return f"{name} upscales by {', '.join(map(str, network.scales))} only"
    return ""
