"""The kinds of jobs: what each takes, which options it has and which formats it writes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, cast

from ciir.errors import InvalidOption, UnknownModel
from ciir.models import catalogue
from ciir.renderer.displays.pictures import USES, find_kind, find_target
from ciir.renderer.readers.names import clean_text
from ciir.renderer.writers import pictures
from ciir.renderer.writers.depth import maps
from ciir.renderer.writers.file_types import BINARY, FileType
from ciir.renderer.writers.formats import FORMATS, check_options
from ciir.renderer.writers.stacks import PLANE, STACK, check_rate
from ciir.service.pipeline.options.displays import DISPLAYS
from ciir.service.pipeline.options.focus import CAMERAS, FOCUS
from ciir.service.pipeline.options.lenslet import LENSLET
from ciir.service.pipeline.options.mesh import MESH
from ciir.service.pipeline.options.options import OPTIONS, RECONSTRUCTION, Options, describe
from ciir.service.pipeline.options.reading import READING
from ciir.service.pipeline.options.upscaling import AUTO, NO_MODEL, OTHER_SCALES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from ciir.renderer.displays.pictures import Kind as DisplayKind

KindName = Literal["reconstruction", "upscale", "elemental", "display", "plane", "disparity", "inspection"]
_PICTURES = tuple(pictures.FORMATS)
_INPUT = tuple(name for name in (*READING, *LENSLET, *MESH) if name != "neighbour_time")
"""Options of kinds of jobs that use all views."""
_ANY_SIZE = 2**62
"""A limit in pixels that never applies: the size of a display is checked where the limits are known."""
MODEL_FIRST = (
    "a network or interpolation that upscales the views first: a name that `ciir models` lists, auto or none "
    "(default none)"
)
"""Help of the option `model` for results that are made of the views."""

ONE_POSE = {name: OPTIONS[name].help.partition("; several")[0] for name in ("rotate", "time")}
"""Help of options for commands in which several values don't make a video."""


MODELS = {"glb": FileType("glb", (".glb",), "model/gltf-binary"), "ply": FileType("ply", (".ply",), BINARY)}
"""Formats of captured models, by name."""
FILE_TYPES: dict[str, FileType] = {
    "json": FileType("json", (".json",), "application/json"),
    **MODELS,
    **maps.FORMATS,
    **FORMATS,
}
"""File types by the name of the format."""


@dataclass(frozen=True)
class Kind:
    """A kind of job."""

    name: KindName
    summary: str
    takes: str
    """A description of the file."""
    options: tuple[str, ...]
    """Names of its options."""
    formats: tuple[str, ...]
    """Names of the formats that it writes."""
    default_format: str
    """The rule that selects the format if none is given."""
    help: Mapping[str, str] = field(default_factory=dict)
    """Help texts that differ from those in `OPTIONS`."""
    defaults: Mapping[str, str] = field(default_factory=dict)
    """Default values, as text, that differ from those of `Options`."""
    checks: tuple[Callable[[Options], None], ...] = ()
    """Each raises `InvalidOption` if options don't go together."""
    format_check: Callable[[Options, str | None], object] | None = None
    """Raises `InputError` if options don't fit the format."""

    @property
    def plural(self) -> str:
        """The name in the URL: `POST /v1/PLURAL` makes one."""
        return "disparities" if self.name == "disparity" else f"{self.name}s"

    @property
    def takes_scenes(self) -> bool:
        """Whether a shipped scene can be given instead of the file, as it can wherever a mesh can."""
        return not set(self.options).isdisjoint(MESH)

    @property
    def takes_light_fields(self) -> bool:
        """Whether the file can be a light field, including one in a single picture."""
        return "arrangement" in self.options

    def parse(self, texts: Mapping[str, str]) -> Options:
        """Parses the options in `texts`, with the defaults of this kind.

        Raises `InvalidOption`, also for options that don't go together.
        """
        options = Options.parse({**self.defaults, **texts})
        for check in (Options.check_lens_grid, *self.checks):
            check(options)
        return options

    def check_format(self, options: Options, name: str | None) -> None:
        """Raises `InputError` for an option that the format `name` doesn't use. None is the default format."""
        if self.format_check is not None:
            self.format_check(options, name)

    def list_models(self) -> list[str]:
        """Lists the values of the option `model`."""
        if self.name == "upscale":
            return [AUTO, *catalogue.list_single_image_names()]
        return [AUTO, *catalogue.list_names(), NO_MODEL]

    def check_model(self, name: str) -> None:
        """Raises `UnknownModel` if `name` is not in `list_models`."""
        known = self.list_models()
        if name not in known:
            is_field = name in catalogue.list_names()
            others = f"{name} takes the views of a light field, in a reconstruction; for pictures " if is_field else ""
            lacks = "" if is_field else f"no {clean_text(name)[:40]!r} here; "
            raise UnknownModel(f"model: {lacks}{others}give one of {', '.join(known)}")

    def describe_option(self, name: str) -> dict[str, Any]:
        """Returns the JSON schema (as in OpenAPI 3.0) of an option in this kind's form."""
        schema = describe(name)
        if name in self.help:
            schema["description"] = self.help[name]
        if name in self.defaults:
            schema["default"] = self.defaults[name]
        return schema | ({"enum": self.list_models()} if name == "model" else {})


def _check_views(options: Options, name: str | None) -> None:
    what = "the default format, png or zip," if name is None else f"format {name}"
    check_options(options, FORMATS[name or "zip"].uses, what)


def _check_display(options: Options, name: str | None) -> None:
    kind = find_kind(options) if name is None else cast("DisplayKind", name)
    check_options(options, USES[kind], f"format {kind}")
    find_target(kind, options, max_pixels=_ANY_SIZE)


def _check_disparity(options: Options, name: str | None) -> None:
    if options.points == "yes" and name != "ply":
        raise InvalidOption("points: only a PLY holds points; leave it out or make a ply")
    if options.camera_pitch is not None and name not in MODELS:
        raise InvalidOption(
            f"camera_pitch: it places a 3D model and changes no disparity; leave it out or make a {' or '.join(MODELS)}"
        )


def find_plane_format(options: Options, name: str | None) -> str:
    """Returns the format for depth planes.

    Raises `InvalidOption` if it can't hold that many planes, or has no frames per second.
    """
    is_one = options.count_planes() == 1
    found, writers = name or ("png" if is_one else "zip"), PLANE if is_one else STACK
    if found not in writers:
        what = "one plane" if is_one else "a stack of planes"
        raise InvalidOption(f"format: {found} can't hold {what}; give {', '.join(writers)}")
    check_rate(options.fps, found)
    return found


KINDS: dict[KindName, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "reconstruction",
            "Reconstruct views from a mesh, an EIA picture or a zip of views",
            "a mesh, an EIA picture, or a zip of views",
            RECONSTRUCTION,
            tuple(name for name in FORMATS if name not in USES),
            "png for one view, else zip",
            format_check=_check_views,
        ),
        Kind(
            "upscale",
            "Upscale a picture",
            "a PNG, TIFF, JPEG, WebP, PPM, PGM or BMP picture; 8 or 16 bit; grey, RGB, alpha",
            ("model", "scale", "skip"),
            _PICTURES,
            "tiff for a TIFF, else png",
            {
                "model": f"a single-picture network or interpolation; default auto: {catalogue.FALLBACK}, or its int8 "
                "twin if the processor supports it, averaged with bicubic interpolation if its picture doesn't fit the "
                "input",
                "scale": "output pixels for each input pixel along a side, 1 to 8 (default 2); " + OTHER_SCALES,
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
                **ONE_POSE,
                "lenses": "rows x columns of lenses (default 100x100)",
                "pixels": "rows x columns of pixels under each lens (default 15x15)",
                "pitch": "distance between lenses in scene units (default 1)",
                "delta": "pixel size / gap (default 0.4 / the larger of the two numbers in --pixels)",
                "parallax": "the whole viewing angle in degrees, instead of --delta (default 22.6)",
                "pickup": "virtual: elemental images are upright; optical: turned by 180 degrees (default virtual)",
            },
        ),
        Kind(
            "display",
            "Make a picture for a light-field display",
            "a mesh, an EIA picture, or a zip of views",
            (*DISPLAYS, "model", "scale", "fusion", *_INPUT),
            tuple(USES),
            "panel with a display, lenticular with a calibration or a print, else quilt",
            {
                **ONE_POSE,
                "model": MODEL_FIRST,
                "place": "position of a mesh: -1 behind the display, 0 centred on it, 1 in front of it (default 0)",
            },
            {"model": NO_MODEL},
            format_check=_check_display,
        ),
        Kind(
            "plane",
            "Refocus a light field: depth planes, or a picture that is in focus everywhere",
            "a mesh, an EIA picture, a zip of views, or a light field in one file",
            (
                "disparity",
                *(name for name in FOCUS if name not in ("view", "points")),
                *("model", "scale", "fusion", "fps"),
                *_INPUT,
            ),
            tuple(dict.fromkeys((*PLANE, *STACK))),
            "png for one plane, else zip",
            {
                **ONE_POSE,
                "model": MODEL_FIRST,
                "disparity": "focus on content that moves by this many pixels from view to view, in pixels of the "
                "views that are read; as in `ciir depth`, larger is nearer, and 0 is the lens array's plane or, for "
                "parallel cameras, infinity",
            },
            {"model": NO_MODEL},
            (Options.check_planes,),
            find_plane_format,
        ),
        Kind(
            "disparity",
            "Estimate the disparity of a view, or make a 3D model of what the views show",
            "an EIA picture, a zip of views, a light field in one file, or a mesh",
            ("view", "limits", "camera_pitch", *CAMERAS, "points", "model", "scale", "fusion", *_INPUT),
            (*maps.FORMATS, *MODELS, "zip"),
            "pfm",
            {
                **ONE_POSE,
                "model": MODEL_FIRST,
                "camera_pitch": "for a 3D model of a camera array, with true depths and widths: distance between "
                "cameras in millimetres",
            },
            {"model": NO_MODEL},
            (Options.check_limits, Options.check_cameras),
            _check_disparity,
        ),
        Kind(
            "inspection",
            "Find out what a file contains, and which lens grid it may have",
            "any file that a reconstruction takes",
            _INPUT,
            ("json",),
            "json",
        ),
    )
}
"""Kinds of jobs by name."""
