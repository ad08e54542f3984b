"""The options of jobs: parsed, checked and described here for the command line, HTTP and Python."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.readers.names import clean_text
from ciir.service.pipeline.options.displays import DISPLAYS
from ciir.service.pipeline.options.focus import FOCUS, FocusOptions
from ciir.service.pipeline.options.lenslet import LENSLET, LensletOptions
from ciir.service.pipeline.options.mesh import MESH, MeshOptions
from ciir.service.pipeline.options.reading import READING, ReadingOptions
from ciir.service.pipeline.options.upscaling import UPSCALING, UpscalingOptions
from ciir.service.pipeline.options.writing import WRITING, WritingOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

OPTIONS = FOCUS | READING | LENSLET | UPSCALING | MESH | DISPLAYS | WRITING
"""By name, in the order of the help."""
NAMES = tuple(OPTIONS)
RECONSTRUCTION = tuple(name for name in OPTIONS if name not in FOCUS and name not in DISPLAYS)
"""The names of a reconstruction's."""


@dataclass(frozen=True)
class Options(WritingOptions, MeshOptions, UpscalingOptions, LensletOptions, ReadingOptions, FocusOptions):
    """Options of a job, which `OPTIONS` describes. Raises `InvalidOption` where one is out of range by itself.

    `service.pipeline.job` checks whether they fit the input.
    """

    def __post_init__(self) -> None:
        for name, option in OPTIONS.items():
            option.type.check(name, getattr(self, name))

    @classmethod
    def parse(cls, texts: Mapping[str, str]) -> Options:
        """Options from text, as the command line and form fields give it. Raises `InvalidOption`."""
        return cls.convert(texts)

    @classmethod
    def convert(cls, given: Mapping[str, object], names: Sequence[str] = NAMES) -> Options:
        """Options from Python values: pairs and colours as sequences of whole numbers, views as pairs (v, u), `skip` as
        a bool; text is parsed as on the command line, and None is the default. Raises `InvalidOption`, also for one
        that is not among `names`.
        """
        return cls(**_parse(given, names))

    def as_dict(self, names: Sequence[str] = NAMES) -> dict[str, Any]:
        """The options `names`, ready for JSON."""
        return {name: getattr(self, name) for name in names}


def write_texts(given: Mapping[str, object], names: Sequence[str] = NAMES) -> dict[str, str]:
    """The options in `given`, as `Options.convert` takes them, as text for form fields. Raises `InvalidOption`, also
    for one that is not among `names`.
    """
    return {name: OPTIONS[name].type.write(value) for name, value in _parse(given, names).items()}


def describe(name: str) -> dict[str, Any]:
    """JSON schema (as in OpenAPI 3.0) of the option `name` in a form."""
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
        raise InvalidOption(f"{listed}: no such option; known are {', '.join(names)}")
    return {name: OPTIONS[name].type.parse(name, value) for name, value in given.items() if value is not None}
