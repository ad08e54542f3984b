"""The options of a reconstruction: parsed, checked and described here for the command line, HTTP and Python."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, get_args

from ciir.errors import InvalidOption
from ciir.models.catalogue import DEFAULT, LIGHT_FIELD_DEFAULT
from ciir.renderer.light_field import OrderCheck, Pickup
from ciir.renderer.readers.names import clean_text
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.values import make_integer, make_name, make_number, make_switch

if TYPE_CHECKING:
    from collections.abc import Mapping

Strategy = Literal["upscale", "direct", "auto"]
Backend = Literal["auto", "raster", "raytrace"]
Sampling = Literal["pinhole", "lenslet"]
Skip = Literal["exact", "none"]
AUTO, NO_MODEL = "auto", "none"
"""Values of `model` beside the names of the catalogue: select the model; write views as they were made."""
AUTO_MODEL = (
    f"{LIGHT_FIELD_DEFAULT} for views of a grid of 3x3 and up (of a mesh: within the neighbour time), else {DEFAULT}; "
    "their int8 twins where the processor supports them"
)
"""The rule of `auto` in words; `service.pipeline.model_selection` applies it."""
MAX_SCALE = 8


@dataclass(frozen=True)
class Option:
    """How an option is described and written."""

    placeholder: str
    """Of its value, in the help of the command line."""
    help: str
    """A line."""
    type: values.ValueType
    example: str
    """A value's text."""


OPTIONS = {
    "lenses": Option(
        "RxC",
        "rows x columns of lenses (a mesh: 100x100 by default; an EIA needs this or --pixels)",
        values.PAIR,
        "50x50",
    ),
    "pixels": Option(
        "KvxKu", "rows x columns of pixels under each lens (a mesh: 15x15 by default)", values.PAIR, "9x9"
    ),
    "views": Option(
        "SPEC",
        "center, cross, all, or pairs of row and column like '0,0;7,7' (default center)",
        values.VIEWS,
        "cross",
    ),
    "model": Option(
        "NAME",
        f"a model that `ciir models` lists, none to write views as they are, or auto: {AUTO_MODEL} (default auto)",
        values.TEXT,
        "auto",
    ),
    "scale": Option(
        "S", "output pixels for each view pixel along a side, 1 to 8 (default 2)", make_integer(1, MAX_SCALE), "2"
    ),
    "neighbour_time": Option(
        "SECONDS",
        "for a mesh: by how much the views around may prolong the job, as model auto predicts; 0: never (default 1)",
        make_number(0, 1e6, "seconds such as 0.5"),
        "0.5",
    ),
    "strategy": Option(
        "NAME",
        "upscale: upscale the views; direct: render a mesh at the larger size; auto: the faster one (default upscale)",
        make_name(get_args(Strategy)),
        "auto",
    ),
    "backend": Option(
        "NAME",
        "what renders a mesh: raster (OpenGL), raytrace (Embree), or auto, the faster (default auto)",
        make_name(get_args(Backend)),
        "raytrace",
    ),
    "sampling": Option(
        "NAME",
        "how a lens sees a mesh: pinhole, one point; lenslet, the mean over its pitch (default pinhole)",
        make_name(get_args(Sampling)),
        "lenslet",
    ),
    "pickup": Option(
        "NAME",
        "virtual: elemental images are upright; optical: turned by 180 degrees (default virtual)",
        make_name(get_args(Pickup)),
        "optical",
    ),
    "order": Option(
        "NAME",
        "auto: put a set of views right whose order is certainly wrong; given: keep the order (default auto)",
        make_name(get_args(OrderCheck)),
        "given",
    ),
    "skip": Option(
        "NAME",
        "exact: skip triangles and pixels that can't change the result; none: compute everything (default exact)",
        make_switch(get_args(Skip)),
        "none",
    ),
    "background": Option("RRGGBB", "colour behind a mesh (default 000000)", values.COLOUR, "ffffff"),
    "pitch": Option(
        "LENGTH", "distance between lenses in scene units (a mesh: 1 by default)", make_number(1e-9, 1e9), "0.5"
    ),
    "delta": Option(
        "TANGENT",
        "pixel size / gap (a mesh: 0.4 / the larger count of pixels by default)",
        make_number(1e-9, 1e9),
        "0.02",
    ),
}
"""By name, in the order of the help."""
NAMES = tuple(OPTIONS)


@dataclass(frozen=True)
class Options:
    """Options of a job, which `OPTIONS` describes. Raises `InvalidOption` where one is out of range by itself.

    `service.pipeline.job` checks whether they fit the input.
    """

    lenses: tuple[int, int] | None = None
    pixels: tuple[int, int] | None = None
    views: str = "center"
    model: str = AUTO
    scale: int = 2
    neighbour_time: float = 1.0
    """Seconds."""
    strategy: Strategy = "upscale"
    backend: Backend = "auto"
    sampling: Sampling = "pinhole"
    pickup: Pickup = "virtual"
    order: OrderCheck = "auto"
    skip: Skip = "exact"
    background: tuple[int, int, int] = (0, 0, 0)
    """RGB, 0 to 255."""
    pitch: float | None = None
    delta: float | None = None

    def __post_init__(self) -> None:
        for name, option in OPTIONS.items():
            option.type.check(name, getattr(self, name))

    @classmethod
    def parse(cls, texts: Mapping[str, str]) -> Options:
        """Options from text, as the command line and form fields give it. Raises `InvalidOption`."""
        return cls.convert(texts)

    @classmethod
    def convert(cls, given: Mapping[str, object]) -> Options:
        """Options from Python values: pairs and colours as sequences of whole numbers, views as pairs (v, u), `skip` as
        a bool; text is parsed as on the command line, and None is the default. Raises `InvalidOption`.
        """
        return cls(**_parse(given))

    def as_dict(self) -> dict[str, Any]:
        """Every option by name, ready for JSON."""
        return asdict(self)


def write_texts(given: Mapping[str, object]) -> dict[str, str]:
    """The options in `given`, as `Options.convert` takes them, as text for form fields. Raises `InvalidOption`."""
    return {name: OPTIONS[name].type.write(value) for name, value in _parse(given).items()}


def describe(name: str) -> dict[str, Any]:
    """JSON schema (as in OpenAPI 3.0) of the option `name` in a form."""
    option = OPTIONS[name]
    schema = option.type.schema | {"description": f"{option.placeholder}: {option.help}", "example": option.example}
    is_text = schema["type"] == "string"
    schema["example"] = option.example if is_text else option.type.read(name, option.example)
    default = next(field.default for field in fields(Options) if field.name == name)
    return schema if default is None else schema | {"default": option.type.write(default) if is_text else default}


def _parse(given: Mapping[str, object]) -> dict[str, Any]:
    unknown = sorted(set(given) - set(NAMES))
    if unknown:
        listed = ", ".join(repr(clean_text(name)[:40]) for name in unknown[:5])
        raise InvalidOption(f"{listed}: no such option; known are {', '.join(NAMES)}")
    return {name: OPTIONS[name].type.parse(name, value) for name, value in given.items() if value is not None}
