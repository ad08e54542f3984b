"""The types of JSON in requests and responses: the schemas of the OpenAPI document are made of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypeVar

from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict  # pydantic takes no other before Python 3.12

from ciir.models.cards import Card  # noqa: TC001 - pydantic evaluates the annotations
from ciir.renderer.light_field import DepthSense  # noqa: TC001
from ciir.service.jobs.job import State  # noqa: TC001
from ciir.service.pipeline.options import KindName  # noqa: TC001

REF = "#/components/schemas/{model}"
"""Where the document has a schema."""
_Class = TypeVar("_Class", bound=type)


def _described(kind: _Class) -> _Class:
    """Has pydantic take the docstrings of attributes as descriptions."""
    return with_config(ConfigDict(use_attribute_docstrings=True))(kind)


@_described
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


@_described
class Progress(TypedDict):
    """The last progress of the current run."""

    stage: Literal["decode", "plan", "render", "map", "upscale", "encode"]
    """The earliest at work, for which the others wait; stages overlap."""
    views_done: int
    views: int
    """0 until it is known."""


@_described
class ResultFile(TypedDict):
    """The result of a job that is done."""

    url: str
    """Its path."""
    format: str
    size: int
    """Bytes."""


@_described
class Event(TypedDict, total=False):
    """A server-sent event of a job."""

    id: str
    """Its number, from 0."""
    event: Literal["queued", "running", "progress", "done", "failed", "cancelled"]
    data: str
    """JSON."""
    retry: int
    """Milliseconds after which to reconnect."""


@_described
class Input(TypedDict):
    """What was read."""

    name: str
    kind: str
    """A file type, or `views` for a set of pictures."""
    bytes: int
    files: int
    triangles: NotRequired[int]
    """Of a mesh."""
    parts: NotRequired[int]
    """Of a mesh."""
    height: NotRequired[int]
    """Pixels of all views side by side, of a light field."""
    width: NotRequired[int]
    channels: NotRequired[int]
    bits: NotRequired[int]
    """Of a channel."""


@_described
class LensArray(TypedDict):
    """The lens array. `pitch` and `delta` are null where nothing is known of them."""

    rows: int
    cols: int
    pitch: float | None
    """Distance between lenses, in scene units; of a raw lenslet picture in its pixels."""
    pixels_v: int
    pixels_u: int
    delta: float | None
    """Tangent from one pixel under a lens to the next."""
    depth_sense: DepthSense
    """`lenses`: what is farther moves further to the left from one view to the next on the right; `cameras`: what is
    nearer does."""


@_described
class Skipped(TypedDict):
    """What needed no computation."""

    pixels: NotRequired[int]
    """Input pixels of the model."""
    uniform: NotRequired[float]
    """Share of `pixels` in regions of one colour."""
    repeated: NotRequired[float]
    """Share of `pixels` whose neighbourhood had been computed."""
    saved_ms: NotRequired[float | None]
    """Null where all were skipped."""
    culled: NotRequired[float]
    """Share of a mesh's triangles."""


@_described
class UsedModel(TypedDict):
    """The model that ran."""

    name: str
    scale: int
    sha256: str | None
    """Of its file; null for interpolation."""
    fallback: NotRequired[UsedModel]
    """What made the pixels of low confidence, with a light-field network."""


@_described
class Plan(TypedDict):
    """How views were made, and why."""

    strategy: Literal["upscale", "direct"]
    backend: str | None
    """Null for a light field."""
    sampling: Literal["pinhole", "lenslet"] | None
    samples: int
    """Along each side of a lens's cell, of a mesh."""
    model: str
    scale: int
    reasons: list[str]
    skipped: Skipped | None


@_described
class ElementalPlan(TypedDict):
    """How an elemental image array was made, and why."""

    backend: str
    sampling: Literal["pinhole", "lenslet"]
    samples: int
    """Along each side of a lens's cell."""
    pickup: Literal["virtual", "optical"]
    reasons: list[str]


class _AnyReport(TypedDict):
    notes: list[str]
    timings_ms: Annotated[dict[str, float], Field(description="Milliseconds of each stage that ran, and `total`.")]
    versions: Annotated[dict[str, str], Field(description="Of the packages that took part.")]


@_described
class ReconstructionReport(_AnyReport):
    """`report.json` without its list of views."""

    input: Input
    lens_array: LensArray
    scene_transform: list[list[float]] | None
    """4x4, row-major: from a mesh's coordinates to those of the lens array."""
    plan: Plan
    model: UsedModel | None
    options: dict[str, Any]
    """All options with their values."""


@_described
class UpscaledPicture(TypedDict):
    """A picture that was upscaled, and its size then."""

    input: str
    file: str
    height: int
    width: int
    channels: int
    bits: int


@_described
class UpscaleReport(_AnyReport):
    """The report of an upscaled picture."""

    pictures: list[UpscaledPicture]
    model: UsedModel
    skipped: Skipped


@_described
class ElementalReport(_AnyReport):
    """The report of an elemental image array."""

    input: Input
    lens_array: LensArray
    scene_transform: list[list[float]]
    """4x4, row-major: from the mesh's coordinates to those of the lens array."""
    plan: ElementalPlan


@_described
class DisplayReport(_AnyReport):
    """The report of a picture for a display."""

    input: Input
    display: dict[str, Any]
    """Its `kind` and numbers, among them `layout` of a quilt: `cols`, `rows`, `aspect`."""
    scene_transform: list[list[float]] | None
    """4x4, row-major: from a mesh's coordinates to those of the display."""
    options: dict[str, Any]
    """All options with their values."""


class _Status(TypedDict):  # pydantic inherits no descriptions from docstrings
    id: Annotated[str, Field(pattern="^[0-9a-f]{32}$", description="Hash of the input, the options and the format.")]
    state: State
    created: Annotated[str, Field(json_schema_extra={"format": "date-time"})]
    attempts: Annotated[int, Field(ge=0, description="How often it was started.")]
    input: Annotated[str, Field(description="`upload` and the suffix of the file's name.")]
    options: Annotated[dict[str, str], Field(description="As they were sent.")]
    format: Annotated[str | None, Field(description="As requested; once the job is done, that of the result.")]
    events: Annotated[str, Field(description="Path of its server-sent events.")]
    progress: Progress | None
    result: NotRequired[Annotated[ResultFile, Field(description="If it is done.")]]
    problem: NotRequired[Annotated[Problem, Field(description="Why it failed, if it has; 410 if its result is lost.")]]


@_described
class Reconstruction(_Status):
    """Status of a reconstruction."""

    report: NotRequired[ReconstructionReport]
    """If it is done."""


@_described
class Upscale(_Status):
    """Status of an upscaling."""

    report: NotRequired[UpscaleReport]
    """If it is done."""


@_described
class Elemental(_Status):
    """Status of an elemental image array."""

    report: NotRequired[ElementalReport]
    """If it is done."""


@_described
class Display(_Status):
    """Status of a picture for a display."""

    report: NotRequired[DisplayReport]
    """If it is done."""


@_described
class Model(TypedDict):
    """A model of the catalogue."""

    name: str
    kind: str
    """A short description."""
    scales: list[int]
    """The factors it upscales by, ascending."""
    takes: Literal["a picture", "a view and those around it"]
    default: bool
    """Whether it is the default for single pictures."""
    card: Card | None
    """Null for interpolation, which was not trained."""


STATUSES: dict[KindName, type] = {
    "reconstruction": Reconstruction,
    "upscale": Upscale,
    "elemental": Elemental,
    "display": Display,
}
"""The type of a status, by kind of job."""
TYPES = (Event, Problem, Model, *STATUSES.values())
"""All types that the document has by name."""


def refer(name: str) -> dict[str, str]:
    """A reference to a schema in the document."""
    return {"$ref": REF.format(model=name)}
