"""Which model upscales the views: the one that was named, or the one that suits them best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.errors import UnknownModel
from ciir.models import catalogue, processor
from ciir.models.light_field.views import list_required_views
from ciir.models.light_field.windows import MINIMUM_GRID
from ciir.service.pipeline.options import AUTO, NO_MODEL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.models.catalogue import Entry
    from ciir.renderer.views import View
    from ciir.service.pipeline.options import Options


@dataclass(frozen=True)
class Job:
    """What is known of an input, and what is wanted of it, before anything is planned."""

    name: str
    is_mesh: bool
    grid: tuple[int, int]
    """Views there are, rows and columns."""
    is_transparent: bool
    """Whether some pixel of some view is not opaque. A mesh's are."""
    wanted: Sequence[View]


@dataclass(frozen=True)
class Choice:
    """A model, and what the report says of it."""

    model: str
    """A name of the catalogue, or `none`."""
    is_light_field: bool = False
    """Whether it takes a view with those around it."""
    reasons: tuple[str, ...] = ()


def check_model(name: str) -> None:
    """Raises `UnknownModel` where `name` is no value of the option `model`."""
    known = (*catalogue.list_names(), AUTO, NO_MODEL)
    if name not in known:
        raise UnknownModel(f"model: no {name[:40]!r} here; give one of {', '.join(known)}")


def choose(options: Options, job: Job) -> Choice:
    """What `options.model`, one that `check_model` lets pass, comes to for `job`.

    `auto` takes `catalogue.light_field_default_name()` where the views around each wanted one are there or are made
    anyway, elsewhere `catalogue.default_name()`: int8 networks where the processor is made for them. A light-field
    network that was named has a mesh's neighbours rendered; where views can't help one another the default takes its
    place.
    """
    if options.model == NO_MODEL:
        return Choice(NO_MODEL)
    fields = {entry.name: entry for entry in catalogue.list_entries() if entry.is_light_field}
    default, field, further = catalogue.default_name(), catalogue.light_field_default_name(), _further(job)
    if options.model == AUTO:
        against = _against(field, fields.get(field), options.scale, job, further)
        if against:
            return Choice(default, reasons=(f"model auto: {default}, view by view, as {against}{_precision(default)}",))
        return Choice(field, True, (f"model auto: {field}, as {_views(job)} help one another{_precision(field)}",))
    if options.model not in fields:
        return Choice(options.model)
    if alone := _alone(job):
        return Choice(default, reasons=(f"{default}, view by view, in place of {options.model}, as {alone}",))
    rendered = f"{options.model}: views around those asked for are rendered too, {further} of them"
    return Choice(options.model, True, (rendered,) if further else ())


def _precision(name: str) -> str:
    """Why `auto` takes the network `name` in its precision."""
    card = next(entry.card for entry in catalogue.list_entries() if entry.name == name)
    if card is not None and card.precision == "int8":
        return "; in int8, which this processor is made for"
    against = processor.int8_unsupported_reason()
    return f"; in float, as {against}" if against else ""


def _views(job: Job) -> str:
    return f"the {job.grid[0]}x{job.grid[1]} views"


def _alone(job: Job) -> str:
    """Why the views of `job` can't help one another; empty where they can."""
    if min(job.grid) < MINIMUM_GRID:
        return f"{_views(job)} are not the {MINIMUM_GRID}x{MINIMUM_GRID} or more that help one another"
    if job.is_transparent:
        return "views with transparency can't help one another"
    return ""


def _further(job: Job) -> int:
    """How many views of a mesh would be rendered only to help those that are wanted."""
    return len(set(list_required_views(job.wanted, job.grid)) - set(job.wanted)) if job.is_mesh else 0


def _against(name: str, field: Entry | None, scale: int, job: Job, further: int) -> str:
    """Why `auto` doesn't take `field`, the model `name`; empty where it does."""
    if field is None:
        return f"{name} is not installed"
    if alone := _alone(job):
        return alone
    if scale not in field.scales:
        return f"{name} upscales by {', '.join(map(str, field.scales))} only"
    if further:
        return f"{name} would have {further} more rendered around those asked for; name it for more accuracy"
    return ""
