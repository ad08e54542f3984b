"""The options of jobs: parsed, checked and described here for the command line, HTTP and Python."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.readers.names import clean_text
from ciir.renderer.writers.options import FormatOptions
from ciir.service.pipeline.options.displays import DISPLAYS
from ciir.service.pipeline.options.focus import FOCUS, FocusOptions
from ciir.service.pipeline.options.lenslet import LENSLET, LensletOptions
from ciir.service.pipeline.options.mesh import MESH, MeshOptions
from ciir.service.pipeline.options.reading import READING, ReadingOptions
from ciir.service.pipeline.options.upscaling import UPSCALING, UpscalingOptions
from ciir.service.pipeline.options.writing import WRITING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

OPTIONS = FOCUS | READING | LENSLET | UPSCALING | MESH | DISPLAYS | WRITING
"""Options by name, in the order of the help."""
NAMES = tuple(OPTIONS)
RECONSTRUCTION = tuple(name for name in OPTIONS if name not in FOCUS and name not in DISPLAYS)
"""Names of the options of a reconstruction."""


@dataclass(frozen=True)
class Options(FormatOptions, MeshOptions, UpscalingOptions, LensletOptions, ReadingOptions, FocusOptions):
    """Options of a job, described in `OPTIONS`. Raises `InvalidOption` if one is out of range by itself.

    `service.pipeline.job` checks whether they fit the input.
    """

    def __post_init__(self) -> None:
        for name, option in OPTIONS.items():
            option.type.check(name, getattr(self, name))

    @classmethod
    def parse(cls, texts: Mapping[str, str]) -> Options:
        """Parses options from text, as given on the command line or in form fields. Raises `InvalidOption`."""
        return cls.convert(texts)

    @classmethod
    def convert(cls, given: Mapping[str, object], names: Sequence[str] = NAMES) -> Options:
        """Converts options from Python values.

        Pairs and colours are sequences of whole numbers, views are pairs (v, u), and `skip` is a bool. Text is parsed
        as on the command line, and None means the default. Raises `InvalidOption`, also for an option that is not in
        `names`.
        """
        return cls(**_parse(given, names))

    def as_dict(self, names: Sequence[str] = NAMES) -> dict[str, Any]:
        """Returns the options in `names`, ready for JSON."""
        return {name: getattr(self, name) for name in names}


def write_texts(given: Mapping[str, object], names: Sequence[str] = NAMES) -> dict[str, str]:
    """Writes the options in `given`, which are what `Options.convert` takes, as text for form fields.

    Raises `InvalidOption`, also for an option that is not in `names`.
    """
    return {name: OPTIONS[name].type.write(value) for name, value in _parse(given, names).items()}


def describe(name: str) -> dict[str, Any]:
    """Returns the JSON schema (as in OpenAPI 3.0) of the option `name` in a form."""
    option = OPTIONS[name]
    schema = option.type.schema | {"description": f"{option.placeholder}: {option.help}", "example": option.example}
    is_text = schema["type"] == "string"
    schema["example"] = option.example if is_text else option.type.read(name, option.example)
    default = next(field.default for field in fields(Options) if field.name == name)
    return schema if default is None else schema | {"default": option.type.write(default) if is_text else default}


def _parse(given: Mapping[str, object], names: Sequence[str]) -> dict[str, Any]:
    unknown = sorted(set(given) - set(names))
    if unknown:
        listed = ", ".join(repr(clean_text(name)[:40]) for name in unknown[:5])
        raise InvalidOption(f"{listed}: no such option; the options are {', '.join(names)}")
    return {name: OPTIONS[name].type.parse(name, value) for name, value in given.items() if value is not None}
