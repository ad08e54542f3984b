"""Selects the model that upscales the views: the one that was named, or the one that suits them best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.models import catalogue, processor
from ciir.models.light_field.views import list_required_views
from ciir.models.light_field.windows import MINIMUM_GRID
from ciir.service.pipeline.options import AUTO, NO_MODEL

if TYPE_CHECKING:
    from ciir.models.catalogue import Entry
    from ciir.service.pipeline.job import Job


@dataclass(frozen=True)
class Selection:
    """A model, and why it was selected."""

    model: str
    """A name of the catalogue, or `none`."""
    is_light_field: bool = False
    """Whether it takes a view with those around it."""
    reasons: tuple[str, ...] = ()
    """Sentences for the report."""


def select_model(job: Job) -> Selection:
    """The model for `job`.

    `auto` takes the default light-field network where the views around each wanted one exist or are rendered anyway,
    elsewhere the default network of single pictures; both are int8 networks where the processor supports them. For a
    light-field network that is named, a mesh's neighbouring views are rendered. Where views can't help each other, the
    default of single pictures replaces a light-field network.
    """
    if job.model == NO_MODEL:
        return Selection(NO_MODEL)
    networks = {entry.name: entry for entry in catalogue.list_entries() if entry.is_light_field}
    default, light_field = catalogue.default_name(), catalogue.light_field_default_name()
    neighbours = _count_neighbours(job)
    if job.model == AUTO:
        reason = _reason_against(light_field, networks.get(light_field), job, neighbours)
        if reason:
            return Selection(
                default, reasons=(f"model auto: {default}, view by view, as {reason}{_precision(default)}",)
            )
        chosen = f"model auto: {light_field}, as {_views(job)} help each other{_precision(light_field)}"
        return Selection(light_field, True, (chosen,))
    if job.model not in networks:
        return Selection(job.model)
    if reason := _no_light_field(job):
        return Selection(default, reasons=(f"{default}, view by view, in place of {job.model}, as {reason}",))
    rendered = f"{job.model}: views around those asked for are rendered too, {neighbours} of them"
    return Selection(job.model, True, (rendered,) if neighbours else ())


def _precision(name: str) -> str:
    """Why `auto` takes the network `name` in its precision."""
    card = next(entry.card for entry in catalogue.list_entries() if entry.name == name)
    if card is not None and card.precision == "int8":
        return "; in int8, which this processor supports"
    against = processor.int8_unsupported_reason()
    return f"; in float, as {against}" if against else ""


def _views(job: Job) -> str:
    return f"the {job.grid[0]}x{job.grid[1]} views"


def _no_light_field(job: Job) -> str:
    """Why the views of `job` can't help each other; empty where they can."""
    if min(job.grid) < MINIMUM_GRID:
        return f"{_views(job)} are fewer than the {MINIMUM_GRID}x{MINIMUM_GRID} that a light-field network needs"
    if job.is_transparent:
        return "views with transparency can't help each other"
    return ""


def _count_neighbours(job: Job) -> int:
    """How many views of a mesh would be rendered only to help those that are wanted."""
    return len(set(list_required_views(job.wanted, job.grid)) - set(job.wanted)) if job.mesh is not None else 0


def _reason_against(name: str, network: Entry | None, job: Job, neighbours: int) -> str:
    """Why `auto` doesn't take `network`, the model `name`; empty where it does."""
    if network is None:
        return f"{name} is not installed"
    if reason := _no_light_field(job):
        return reason
    if job.scale not in network.scales:
        return f"{name} upscales by {', '.join(map(str, network.scales))} only"
    if neighbours:
        return f"{name} would need {neighbours} more views rendered around those asked for; name it for more accuracy"
    return ""
