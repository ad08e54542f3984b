"""The kinds of jobs: what each takes, which options it has and which formats it writes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from ciir.errors import UnknownModel
from ciir.models import catalogue
from ciir.renderer.displays.pictures import USES
from ciir.renderer.readers.names import clean_text
from ciir.renderer.writers import pictures
from ciir.renderer.writers.formats import FORMATS
from ciir.service.pipeline.options.displays import DISPLAYS
from ciir.service.pipeline.options.lenslet import LENSLET
from ciir.service.pipeline.options.mesh import MESH
from ciir.service.pipeline.options.options import NAMES, describe
from ciir.service.pipeline.options.reading import READING
from ciir.service.pipeline.options.upscaling import AUTO, NO_MODEL

if TYPE_CHECKING:
    from collections.abc import Mapping

KindName = Literal["reconstruction", "upscale", "elemental", "display"]
_PICTURES = tuple(entry.name for entry in pictures.FORMATS)


@dataclass(frozen=True)
class Kind:
    """A kind of job."""

    name: KindName
    """`POST /v1/NAMEs` makes one."""
    summary: str
    takes: str
    """The file."""
    options: tuple[str, ...]
    """Names of its options."""
    formats: tuple[str, ...]
    """Names of the formats that it writes."""
    default_format: str
    """A rule in words."""
    help: Mapping[str, str] = field(default_factory=dict)
    """Lines of help that differ from those in `OPTIONS`."""

    def list_models(self) -> list[str]:
        """The values of the option `model`."""
        if self.name == "upscale":
            return [AUTO, *catalogue.list_single_image_names()]
        return [AUTO, *catalogue.list_names(), NO_MODEL]

    def check_model(self, name: str) -> None:
        """Raises `UnknownModel` where `name` is none of `list_models`."""
        known = self.list_models()
        if name not in known:
            raise UnknownModel(f"model: no {clean_text(name)[:40]!r} here; give one of {', '.join(known)}")

    def describe_option(self, name: str) -> dict[str, Any]:
        """JSON schema (as in OpenAPI 3.0) of an option in this kind's form."""
        schema = describe(name)
        if name in self.help:
            schema["description"] = self.help[name]
        return schema | ({"enum": self.list_models()} if name == "model" else {})


KINDS: dict[KindName, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "reconstruction",
            "Reconstruct views from a mesh, an EIA picture or a zip of views",
            "a mesh, an EIA picture, or a zip of views",
            tuple(name for name in NAMES if name not in DISPLAYS),
            tuple(name for name in FORMATS if name not in USES),
            "png for one view, else zip",
        ),
        Kind(
            "upscale",
            "Upscale a picture",
            "a PNG, TIFF, JPEG or WebP picture; 8 or 16 bit; grey, RGB, alpha",
            ("model", "scale", "skip"),
            _PICTURES,
            "tiff for a TIFF, else png",
            {
                "model": f"a model of single pictures (default {catalogue.DEFAULT}, or its int8 twin where the "
                "processor supports it)",
                "scale": "output pixels for each input pixel along a side, 1 to 8 (default 2)",
                "skip": "exact: skip pixels that can't change the result; none: compute everything (default exact)",
            },
        ),
        Kind(
            "elemental",
            "Render a mesh's elemental image array",
            "a mesh, or a zip of one with its textures",
            (
                *("lenses", "pixels", "pitch", "delta", "parallax", "pickup"),
                *(name for name in MESH if name != "neighbour_time"),
            ),
            _PICTURES,
            "png",
            {
                "lenses": "rows x columns of lenses (default 100x100)",
                "pixels": "rows x columns of pixels under each lens (default 15x15)",
                "pitch": "distance between lenses in scene units (default 1)",
                "delta": "pixel size / gap (default 0.4 / the larger count of pixels)",
                "parallax": "the whole viewing angle in degrees, in place of --delta (default 22.6)",
            },
        ),
        Kind(
            "display",
            "Make a picture for a light-field display",
            "a mesh, an EIA picture, or a zip of views",
            tuple(name for name in (*DISPLAYS, *READING, *LENSLET, *MESH) if name != "neighbour_time"),
            tuple(USES),
            "panel with a display, lenticular with a calibration, else quilt",
            {"place": "where a mesh lies: -1 behind the display, 0 astride, 1 before it (default 0)"},
        ),
    )
}
"""By name."""
