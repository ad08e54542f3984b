"""The options of a reconstruction: parsed and checked here for the command line, HTTP and Python."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass, fields
from functools import partial
from numbers import Integral
from operator import index
from typing import TYPE_CHECKING, Any, Literal, get_args

from ciir.errors import InvalidOption
from ciir.models.catalogue import DEFAULT, LIGHT_FIELD_DEFAULT
from ciir.renderer.light_field import OrderCheck, Pickup
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

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
_CHOICES: dict[str, tuple[str, ...]] = {
    "strategy": get_args(Strategy),
    "backend": get_args(Backend),
    "sampling": get_args(Sampling),
    "pickup": get_args(Pickup),
    "order": get_args(OrderCheck),
    "skip": get_args(Skip),
}
_LENGTHS = (1e-9, 1e9)
_LONGEST_NEIGHBOUR_TIME = 1e6


@dataclass(frozen=True)
class Options:
    """A reconstruction's options, which `HELP` describes. Raises `InvalidOption` where one is out of range by itself.

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
        for name, allowed in _CHOICES.items():
            if getattr(self, name) not in allowed:
                raise InvalidOption(f"{name}: {getattr(self, name)[:40]!r} is not known; give {' or '.join(allowed)}")
        if not 1 <= self.scale <= MAX_SCALE:
            raise InvalidOption(f"scale: {self.scale} is out of range; give 1 to {MAX_SCALE}")
        if not 0 <= self.neighbour_time <= _LONGEST_NEIGHBOUR_TIME:  # nan is neither
            raise InvalidOption(f"neighbour_time: {self.neighbour_time} is out of range; give seconds, from 0 to 1e6")
        for name in ("pitch", "delta"):
            length = getattr(self, name)
            if length is not None and not (math.isfinite(length) and _LENGTHS[0] <= length <= _LENGTHS[1]):
                raise InvalidOption(f"{name}: {length} is out of range; give a positive number from 1e-9 to 1e9")

    @classmethod
    def parse(cls, texts: Mapping[str, str]) -> Options:
        """Options from text, as the command line and form fields give it. Raises `InvalidOption`."""
        return cls.convert(texts)

    @classmethod
    def convert(cls, values: Mapping[str, object]) -> Options:
        """Options from Python values: pairs and colours as sequences of whole numbers, views as pairs (v, u), `skip` as
        a bool; text is parsed as on the command line, and None is the default. Raises `InvalidOption`.
        """
        unknown = sorted(set(values) - set(NAMES))
        if unknown:
            listed = ", ".join(repr(clean_text(name)[:40]) for name in unknown[:5])
            raise InvalidOption(f"{listed}: no such option; known are {', '.join(NAMES)}")
        return cls(**{name: _convert(name, value) for name, value in values.items() if value is not None})

    def as_dict(self) -> dict[str, Any]:
        """Every option by name, ready for JSON."""
        return asdict(self)


NAMES = tuple(field.name for field in fields(Options))
"""The options' names, in the order of the help."""
HELP: dict[str, tuple[str, str]] = {
    "lenses": ("RxC", "rows x columns of lenses (a mesh: 100x100 by default; an EIA needs this or --pixels)"),
    "pixels": ("KvxKu", "rows x columns of pixels under each lens (a mesh: 15x15 by default)"),
    "views": ("SPEC", "center, cross, all, or pairs of row and column like '0,0;7,7' (default center)"),
    "model": (
        "NAME",
        f"a model that `ciir models` lists, none to write views as they are, or auto: {AUTO_MODEL} (default auto)",
    ),
    "scale": ("S", "output pixels for each view pixel along a side, 1 to 8 (default 2)"),
    "neighbour_time": (
        "SECONDS",
        "for a mesh: by how much the views around may prolong the job, as model auto predicts; 0: never (default 1)",
    ),
    "strategy": (
        "NAME",
        "upscale: upscale the views; direct: render a mesh at the larger size; auto: the faster one (default upscale)",
    ),
    "backend": ("NAME", "what renders a mesh: raster (OpenGL), raytrace (Embree), or auto, the faster (default auto)"),
    "sampling": (
        "NAME",
        "how a lens sees a mesh: pinhole, one point; lenslet, the mean over its pitch (default pinhole)",
    ),
    "pickup": ("NAME", "virtual: elemental images are upright; optical: turned by 180 degrees (default virtual)"),
    "order": (
        "NAME",
        "auto: put a set of views right whose order is certainly wrong; given: keep the order (default auto)",
    ),
    "skip": (
        "NAME",
        "exact: skip triangles and pixels that can't change the result; none: compute everything (default exact)",
    ),
    "background": ("RRGGBB", "colour behind a mesh (default 000000)"),
    "pitch": ("LENGTH", "distance between lenses in scene units (a mesh: 1 by default)"),
    "delta": ("TANGENT", "pixel size / gap (a mesh: 0.4 / the larger count of pixels by default)"),
}
"""Option -> (placeholder, a line of help), for the command line and OpenAPI alike."""


def _convert(name: str, value: object) -> Any:
    """The value of the option `name`. Raises `InvalidOption` where it is of a wrong type."""
    if isinstance(value, str):
        return _PARSERS.get(name, _strip)(name, value)
    converter, example = _CONVERTERS.get(name, (_refuse, "text"))
    try:
        return converter(value)
    except (IndexError, OverflowError, TypeError, ValueError) as error:
        raise InvalidOption(f"{name}: {clean_text(repr(value))[:40]} is not understood; give {example}") from error


def _refuse(value: Any) -> Any:
    raise TypeError(value)


def _whole_numbers(value: Any, count: int, most: int) -> tuple[int, ...]:
    numbers = tuple(index(number) for number in value)
    if len(numbers) != count or not all(0 <= number <= most for number in numbers):
        raise ValueError
    return numbers


def _view_pairs(value: Any) -> str:
    pairs = [_whole_numbers(pair, 2, _MOST) for pair in ([value] if _is_pair(value) else value)]
    return ";".join(f"{v},{u}" for v, u in pairs)


def _is_pair(value: Any) -> bool:
    return len(value) == 2 and all(isinstance(number, Integral) for number in value)


_MOST = 999_999
"""The largest count that text may hold, too."""
_CONVERTERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "lenses": (partial(_whole_numbers, count=2, most=_MOST), "rows and columns, such as (50, 50)"),
    "pixels": (partial(_whole_numbers, count=2, most=_MOST), "rows and columns, such as (15, 15)"),
    "views": (_view_pairs, "'center', 'cross', 'all', or pairs such as [(0, 0), (7, 7)]"),
    "scale": (index, "a whole number such as 2"),
    "background": (
        partial(_whole_numbers, count=3, most=255),
        "red, green and blue from 0 to 255, such as (255, 255, 255)",
    ),
    "pitch": (float, "a number such as 0.5"),
    "delta": (float, "a number such as 0.5"),
    "neighbour_time": (float, "seconds such as 0.5"),
    "skip": (lambda value: ("none", "exact")[index(value)], "True or False"),
}
"""Option -> what converts a value that is no text, and an example of one."""


def _strip(name: str, text: str) -> str:  # noqa: ARG001 - parsers share one signature
    return text.strip()


def parse_pair(name: str, text: str) -> tuple[int, int]:
    """`5x7` as (5, 7), for the option `name`. Raises `InvalidOption`."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX]\s*(\d{1,6})\s*", text)
    if match is None:
        raise InvalidOption(f"{name}: {text[:40]!r} is not understood; give rows x columns, such as 100x100")
    counts = int(match[1]), int(match[2])
    if 0 in counts:
        raise InvalidOption(f"{name}: {counts[0]}x{counts[1]} is out of range; give at least 1x1")
    return counts


def _integer(name: str, text: str) -> int:
    digits = text.strip()  # `int` alone takes less for white space than this and a pattern's \s do
    if re.fullmatch(r"-?\d{1,6}", digits) is None:
        raise InvalidOption(f"{name}: {text[:40]!r} is not a whole number; give one such as 2")
    return int(digits)


def _number(name: str, text: str) -> float:
    try:
        return float(text.strip())
    except ValueError as error:
        raise InvalidOption(f"{name}: {text[:40]!r} is not a number; give one such as 0.5") from error


def _colour(name: str, text: str) -> tuple[int, int, int]:
    match = re.fullmatch(r"\s*#?([0-9a-fA-F]{2})([0-9a-fA-F]{2})([0-9a-fA-F]{2})\s*", text)
    if match is None:
        raise InvalidOption(f"{name}: {text[:40]!r} is not a colour; give RRGGBB in hexadecimal, such as ffffff")
    return int(match[1], 16), int(match[2], 16), int(match[3], 16)


_PARSERS: dict[str, Callable[[str, str], Any]] = {
    "lenses": parse_pair,
    "pixels": parse_pair,
    "scale": _integer,
    "background": _colour,
    "pitch": _number,
    "delta": _number,
    "neighbour_time": _number,
}
"""Those of options that are more than text."""
