"""What is asked for: the options that the command line, HTTP and Python share, parsed and checked in one place."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, get_args

from ciir.errors import InvalidOption
from ciir.models.catalogue import DEFAULT, LIGHT_FIELD_DEFAULT
from ciir.renderer.light_field import Pickup
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

Strategy = Literal["upscale", "direct", "auto"]
Backend = Literal["auto", "raster", "raytrace"]
Sampling = Literal["pinhole", "lenslet"]
Skip = Literal["exact", "none"]
AUTO, NO_MODEL = "auto", "none"
"""Values of `model` that name none of the catalogue: `service.pipeline.model_selection` chooses; views stay as they
were made."""
AUTO_TAKES = (
    f"{LIGHT_FIELD_DEFAULT} for views of a grid of 3x3 and up (of a mesh: where all are wanted), else {DEFAULT}; their "
    "int8 twins where the processor is made for them"
)
"""What `auto` comes to, in words; `service.pipeline.model_selection` has the rule."""
MAX_SCALE = 8
_CHOICES: dict[str, tuple[str, ...]] = {
    "strategy": get_args(Strategy),
    "backend": get_args(Backend),
    "sampling": get_args(Sampling),
    "pickup": get_args(Pickup),
    "skip": get_args(Skip),
}
_LENGTHS = (1e-9, 1e9)


@dataclass(frozen=True)
class Options:
    """A reconstruction's options. Raises `InvalidOption` where one is out of range by itself.

    Whether they fit the input is known only after it was read: see `service.pipeline.plan`.
    """

    lenses: tuple[int, int] | None = None
    """Rows and columns of the lens array. A mesh: 100x100 by default. An EIA: needed, unless `pixels` is given."""
    pixels: tuple[int, int] | None = None
    """Pixels under each lens, rows (v) and columns (u). A mesh: 15x15 by default."""
    views: str = "center"
    """`center`, `cross`, `all`, or pairs `v,u;v,u`."""
    model: str = AUTO
    """A name of the catalogue; `auto` for what suits the views best; `none` for views as they were made."""
    scale: int = 2
    """Output pixels for each view pixel, along each side."""
    strategy: Strategy = "upscale"
    """`upscale` views by the model; `direct`: render a mesh at the larger size; `auto`: the quicker one."""
    backend: Backend = "auto"
    """What renders a mesh."""
    sampling: Sampling = "pinhole"
    """What a lens does to a mesh's light: `pinhole` takes a point sample, `lenslet` averages over the pitch."""
    pickup: Pickup = "virtual"
    """`optical`: each elemental image of the EIA is turned by 180 degrees, as real lenses do."""
    skip: Skip = "exact"
    """`exact`: triangles that no wanted view needs aren't rendered, and what is known without the model isn't computed:
    the result is the same; `none`: all is."""
    background: tuple[int, int, int] = (0, 0, 0)
    """RGB, 0 to 255, where a mesh leaves a view empty."""
    pitch: float | None = None
    """Distance between lenses in scene units; a mesh: 1 by default, a picture: only written to the report."""
    delta: float | None = None
    """Tangent from one pixel to the next (pixel size / gap); a mesh: 0.4 / the larger count of `pixels`."""

    def __post_init__(self) -> None:
        for name, allowed in _CHOICES.items():
            if getattr(self, name) not in allowed:
                raise InvalidOption(f"{name}: {getattr(self, name)[:40]!r} is not known; give {' or '.join(allowed)}")
        if not 1 <= self.scale <= MAX_SCALE:
            raise InvalidOption(f"scale: {self.scale} is out of range; give 1 to {MAX_SCALE}")
        for name in ("pitch", "delta"):
            length = getattr(self, name)
            if length is not None and not (math.isfinite(length) and _LENGTHS[0] <= length <= _LENGTHS[1]):
                raise InvalidOption(f"{name}: {length} is out of range; give a positive number from 1e-9 to 1e9")

    @classmethod
    def parse(cls, texts: Mapping[str, str]) -> Options:
        """Options from text, as the command line and form fields give it. Raises `InvalidOption`."""
        unknown = sorted(set(texts) - set(NAMES))
        if unknown:
            listed = ", ".join(repr(clean_text(name)[:40]) for name in unknown[:5])
            raise InvalidOption(f"{listed}: no such option; known are {', '.join(NAMES)}")
        return cls(**{name: _PARSERS[name](name, text) for name, text in texts.items()})

    def as_dict(self) -> dict[str, Any]:
        """Every option by name, ready for JSON."""
        return asdict(self)


NAMES = tuple(field.name for field in fields(Options))
"""The options' names, in the order of the help."""
HELP: dict[str, tuple[str, str]] = {
    "lenses": ("RxC", "lens rows x columns (default for a mesh: 100x100; an EIA picture needs them, or pixels)"),
    "pixels": ("KvxKu", "pixels under each lens, rows x columns (default for a mesh: 15x15)"),
    "views": ("SPEC", "center, cross, all, or v,u pairs like '0,0;7,7' (default center)"),
    "model": (
        "NAME",
        f"a listed model, none for views as they are, or auto: {AUTO_TAKES} (default auto)",
    ),
    "scale": ("S", "output pixels for each view pixel, along a side, 1 to 8 (default 2)"),
    "strategy": (
        "NAME",
        "upscale, direct (a mesh rendered at the larger size) or auto, the quicker (default upscale)",
    ),
    "backend": ("NAME", "what renders a mesh: auto, raster or raytrace (default auto)"),
    "sampling": ("NAME", "a mesh's light: pinhole (points) or lenslet (mean over a pitch) (default pinhole)"),
    "pickup": ("NAME", "virtual, or optical: elemental images turned by 180 degrees (default virtual)"),
    "skip": (
        "NAME",
        "exact: no triangle that no ray meets, no model where its result is known; none: all (default exact)",
    ),
    "background": ("RRGGBB", "colour behind a mesh (default 000000)"),
    "pitch": ("LENGTH", "distance between lenses, scene units (default for a mesh: 1)"),
    "delta": ("TANGENT", "pixel size / gap (default for a mesh: 0.4 / the larger count of pixels)"),
}
"""Option -> (placeholder, a line of help), for the command line and OpenAPI alike."""


def _text(name: str, text: str) -> str:  # noqa: ARG001 - parsers share one signature
    return text.strip()


def pair(name: str, text: str) -> tuple[int, int]:
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
    "lenses": pair,
    "pixels": pair,
    "views": _text,
    "model": _text,
    "scale": _integer,
    "strategy": _text,
    "backend": _text,
    "sampling": _text,
    "pickup": _text,
    "skip": _text,
    "background": _colour,
    "pitch": _number,
    "delta": _number,
}
