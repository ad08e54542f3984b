"""The types of reports in JSON."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypeVar

from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict  # pydantic accepts no other before Python 3.12

from ciir.renderer.views import DepthSense  # noqa: TC001 - pydantic evaluates the annotations

_Class = TypeVar("_Class", bound=type)


def described(kind: _Class) -> _Class:
    """Makes pydantic use the docstrings of attributes as descriptions."""
    return with_config(ConfigDict(use_attribute_docstrings=True))(kind)


@described
class Input(TypedDict):
    """The input that was read."""

    name: str
    kind: str
    """A file type, or `views` for a set of pictures."""
    bytes: NotRequired[int]
    """Bytes of the files that were read; missing for a shipped scene."""
    files: NotRequired[int]
    """Files that were read: of a set of views only those that were needed."""
    triangles: NotRequired[int]
    """Only for a mesh."""
    parts: NotRequired[int]
    """Only for a mesh."""
    height: NotRequired[int]
    """Only for a light field: pixels of all views side by side."""
    width: NotRequired[int]
    channels: NotRequired[int]
    bits: NotRequired[int]
    """Bits of a channel."""


@described
class LensArray(TypedDict):
    """The lens array. `pitch` and `delta` are null if they are unknown."""

    rows: int
    cols: int
    pitch: float | None
    """Distance between lenses: in scene units, or for a raw lenslet picture in its pixels."""
    pixels_v: int
    pixels_u: int
    delta: float | None
    """Tangent from one pixel under a lens to the next."""
    depth_sense: DepthSense
    """`lenses`: farther content moves further to the left from one view to the next on the right; `cameras`: nearer
    content does."""


@described
class Skipped(TypedDict):
    """What was skipped because it needed no computation."""

    pixels: NotRequired[int]
    """Input pixels of the model."""
    uniform: NotRequired[float]
    """Share of `pixels` in regions of one colour."""
    culled: NotRequired[float]
    """Share of a mesh's triangles that were left out."""


@described
class UsedModel(TypedDict):
    """The model that ran."""

    name: str
    scale: int
    sha256: str | None
    """SHA-256 of its file; null for interpolation."""
    fallback: NotRequired[UsedModel]
    """Only with a light-field network: the model that made the pixels of low confidence."""


@described
class Plan(TypedDict):
    """How views were made, and why."""

    strategy: Literal["upscale", "direct"]
    backend: str | None
    """Null for a light field."""
    sampling: Literal["pinhole", "lenslet"] | None
    """For a light field: `lenslet` if upscaled views were brought closer to the lenslets' means, else null."""
    samples: int
    """For a mesh: samples along each side of a lens's cell."""
    model: str
    scale: int
    reasons: list[str]
    skipped: Skipped | None


@described
class ElementalPlan(TypedDict):
    """How an elemental image array was made, and why."""

    backend: str
    sampling: Literal["pinhole", "lenslet"]
    samples: int
    """Samples along each side of a lens's cell."""
    pickup: Literal["virtual", "optical"]
    reasons: list[str]


class _AnyReport(TypedDict):
    notes: list[str]
    timings_ms: Annotated[dict[str, float], Field(description="Milliseconds of each stage that ran, and `total`.")]
    versions: Annotated[dict[str, str], Field(description="Versions of the packages that were used.")]


@described
class ReconstructionReport(_AnyReport):
    """`report.json` without its list of views."""

    input: Input
    lens_array: LensArray
    scene_transform: list[list[float]] | None
    """4x4, row-major: from a mesh's coordinates to those of the lens array. Null for a light field."""
    plan: Plan
    model: UsedModel | None
    options: dict[str, Any]
    """All options with their values."""


@described
class UpscaledPicture(TypedDict):
    """An upscaled picture, with its size after upscaling."""

    input: str
    file: str
    height: int
    width: int
    channels: int
    bits: int


@described
class UpscaleReport(_AnyReport):
    """The report of an upscaled picture."""

    pictures: list[UpscaledPicture]
    model: UsedModel
    skipped: Skipped


@described
class ElementalReport(_AnyReport):
    """The report of an elemental image array."""

    input: Input
    lens_array: LensArray
    scene_transform: list[list[float]]
    """4x4, row-major: from the mesh's coordinates to those of the lens array."""
    plan: ElementalPlan


@described
class DisplayReport(_AnyReport):
    """The report of a display picture."""

    input: Input
    display: dict[str, Any]
    """Its `kind` and numbers, including `layout` of a quilt: `cols`, `rows`, `aspect`."""
    scene_transform: list[list[float]] | None
    """4x4, row-major: from a mesh's coordinates to those of the display."""
    plan: NotRequired[Plan]
    """Only if a model upscaled a light field's views, as the next."""
    model: NotRequired[UsedModel]
    options: dict[str, Any]
    """All options with their values."""


@described
class Plane(TypedDict):
    """A depth plane."""

    name: str
    """Name of its picture, without a suffix."""
    disparity: NotRequired[float]
    """In pixels of the views that were read; larger is nearer. Missing for a picture that is in focus everywhere."""
    depth: NotRequired[float | None]
    """Only if the geometry is known; null at infinity."""


@described
class PlaneReport(ReconstructionReport):
    """The report of depth planes."""

    planes: list[Plane]
    method: Literal["mapping", "window", "delta"]
    depth_unit: Literal["mm", "scene units"] | None


@described
class DisparityRange(TypedDict):
    """The 1st to 99th percentile of disparities where there is texture and at least that confidence, or the range where
    a mesh is seen.
    """

    least: float
    largest: float
    confidence: float


@described
class DisparityMap(TypedDict):
    """A disparity map. Larger disparities are nearer (HCI 4D light field benchmark)."""

    view: list[int]
    """Row and column."""
    height: int
    width: int
    least: float
    """In pixels of the map."""
    largest: float
    confident: DisparityRange | None
    """Null if the view has too little texture."""
    exact: bool
    """Whether the map was rendered from a mesh, not estimated."""
    format: str
    sense: Literal["larger is nearer"]
    scale: NotRequired[float]
    """Only for a PNG: the disparity is `offset + scale * level`."""
    offset: NotRequired[float]
    darkest: NotRequired[float]
    """Only for a coloured picture: the disparities of its first and last colour."""
    brightest: NotRequired[float]


@described
class Surface(TypedDict):
    """A captured model."""

    vertices: int
    triangles: int


@described
class DisparityReport(ReconstructionReport):
    """The report of a disparity map."""

    disparity: NotRequired[DisparityMap]
    surface: NotRequired[Surface]
    """Only for a model."""


@described
class LensGrid(TypedDict):
    """The lens grid of a raw lenslet picture, whose pixels have their centres at whole numbers."""

    pitch: float
    """Pixels."""
    offset: list[float]
    """(y, x) of the centre of the first lens."""
    rotation: float
    """Degrees. If positive, rows go down to the right."""
    shape: Literal["square", "hexagonal", "hexagonal-columns"]
    stretch: float
    """Distance between rows, relative to that of a regular grid."""


@described
class Candidate(TypedDict):
    """What the picture may be."""

    kind: Literal["eia", "mosaic", "raw"]
    options: dict[str, str]
    """Form fields that make it be read that way."""
    pixels: list[int]
    """Rows and columns of views."""
    lenses: NotRequired[list[int]]
    """Rows and columns of lenses, which are the pixels of a view."""
    lens_grid: NotRequired[LensGrid]
    """Only for a raw lenslet picture."""


@described
class FoundViews(TypedDict):
    """The views of a light field."""

    rows: int
    cols: int
    height: int
    """Height of a view, in pixels."""
    width: int
    depth_sense: DepthSense


@described
class InspectionReport(_AnyReport):
    """What a file contains."""

    kind: Literal["mesh", "views", "eia", "mosaic", "raw", "picture"]
    """`picture`: a picture in which no lenses were found; it needs `lenses` or `pixels`."""
    input: Input
    candidates: list[Candidate]
    """For a picture whose lenses are not given, what it may be, the likeliest first."""
    bounds: NotRequired[list[list[float]]]
    """For a mesh: the lowest and the highest (x, y, z) in its own coordinates."""
    light_field: NotRequired[FoundViews]
    """For views, and for a picture whose lenses are given."""
