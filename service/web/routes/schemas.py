"""The types of JSON in requests and responses. The schemas of the OpenAPI document are made from them."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict  # pydantic accepts no other before Python 3.12

from ciir.models.cards import Card  # noqa: TC001 - pydantic evaluates the annotations
from ciir.service.jobs.job import EventKind, State  # noqa: TC001
from ciir.service.pipeline.options import KindName  # noqa: TC001
from ciir.service.pipeline.report import Stage  # noqa: TC001
from ciir.service.web.routes.reports import (
    DisparityReport,
    DisplayReport,
    ElementalReport,
    InspectionReport,
    PlaneReport,
    ReconstructionReport,
    UpscaleReport,
    described,
)

REF = "#/components/schemas/{model}"
"""The place of a schema in the document."""


@described
class Problem(TypedDict):
    """An error (RFC 9457)."""

    type: str
    """`urn:ciir:...` for errors of ciir, `about:blank` for those of HTTP."""
    title: str
    """The same for all errors of the type."""
    status: int
    detail: str
    """One line: what was given, the limit, the remedy."""
    instance: str
    """The path of the request."""


@described
class Progress(TypedDict):
    """The last progress of the current run."""

    stage: Stage
    """The earliest stage at work, which the others wait for; stages overlap."""
    views_done: int
    views: int
    """0 until it is known."""


@described
class ResultFile(TypedDict):
    """The result of a finished job."""

    url: str
    """Its path."""
    format: str
    size: int
    """Bytes."""


@described
class KeptFile(TypedDict):
    """A file that is kept for several requests."""

    id: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    """Hash of its name and its bytes; the field `file_id` of a job's form."""
    name: str
    """`upload` and the part of the file's name that is used."""
    bytes: int


@described
class Event(TypedDict, total=False):
    """A server-sent event of a job."""

    id: str
    """Its number, from 0."""
    event: EventKind
    data: str
    """JSON."""
    retry: int
    """Milliseconds after which to reconnect."""


class _Status(TypedDict):  # pydantic does not inherit descriptions from docstrings
    id: Annotated[str, Field(pattern="^[0-9a-f]{32}$", description="Hash of the input, the options and the format.")]
    state: State
    created: Annotated[str, Field(json_schema_extra={"format": "date-time"})]
    attempts: Annotated[int, Field(ge=0, description="How many times it was started.")]
    input: Annotated[str, Field(description="`upload` and the part of the file's name that is used, or `scene:NAME`.")]
    options: Annotated[dict[str, str], Field(description="The options as they were sent.")]
    format: Annotated[str | None, Field(description="As requested; once the job is done, the result's format.")]
    events: Annotated[str, Field(description="Path of its server-sent events.")]
    progress: Progress | None
    result: NotRequired[Annotated[ResultFile, Field(description="Only if it is done.")]]
    problem: NotRequired[Annotated[Problem, Field(description="Why it failed, if it did; 410 if its result is lost.")]]


@described
class Reconstruction(_Status):
    """Status of a reconstruction."""

    report: NotRequired[ReconstructionReport]
    """Only if it is done."""


@described
class Upscale(_Status):
    """Status of an upscaling."""

    report: NotRequired[UpscaleReport]
    """Only if it is done."""


@described
class Elemental(_Status):
    """Status of an elemental image array."""

    report: NotRequired[ElementalReport]
    """Only if it is done."""


@described
class Display(_Status):
    """Status of a display picture."""

    report: NotRequired[DisplayReport]
    """Only if it is done."""


@described
class Planes(_Status):
    """Status of a job that makes depth planes."""

    report: NotRequired[PlaneReport]
    """Only if it is done."""


@described
class Disparity(_Status):
    """Status of a disparity map."""

    report: NotRequired[DisparityReport]
    """Only if it is done."""


@described
class Inspection(_Status):
    """Status of an inspection."""

    report: NotRequired[InspectionReport]
    """Only if it is done."""


@described
class Model(TypedDict):
    """A model of the catalogue."""

    name: str
    kind: str
    """A short description."""
    scales: list[int]
    """The factors it upscales by, ascending."""
    takes: Literal["a picture", "a view and those around it"]
    default: bool
    """Whether it is the default for pictures."""
    unsupported_reason: str | None
    """Why the server's processor can't run it; null if it can."""
    card: Card | None
    """Null for interpolation, which was not trained."""


STATUSES: dict[KindName, type] = {
    "reconstruction": Reconstruction,
    "upscale": Upscale,
    "elemental": Elemental,
    "display": Display,
    "plane": Planes,
    "disparity": Disparity,
    "inspection": Inspection,
}
"""The type of a status, by kind of job."""
TYPES = (Event, KeptFile, Problem, Model, *STATUSES.values())
"""All types that the document lists by name."""


def refer(name: str) -> dict[str, str]:
    """Returns a reference to a schema in the document."""
    return {"$ref": REF.format(model=name)}
