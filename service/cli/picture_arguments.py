"""Arguments of the commands that make pictures, with their help."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ciir.renderer.writers.depth import maps
from ciir.renderer.writers.formats import FOLDER, FORMATS, VIDEOS, WHOLE, WHOLE_BY_SUFFIX
from ciir.renderer.writers.pictures import SUFFIXES
from ciir.renderer.writers.stacks import PLANE_BY_SUFFIX, STACK_BY_SUFFIX
from ciir.service.pipeline.options import (
    DISPLAYS,
    FOCUS,
    KINDS,
    LENSLET,
    MESH,
    MODEL_FIRST,
    MODELS,
    ONE_POSE,
    OPTIONS,
    READING,
    UPSCALING,
    WRITING,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ciir.service.pipeline.options import KindName

CONVERSION = tuple(
    name
    for name in (*READING, *LENSLET, "model", "scale", "fusion", *MESH, *WRITING, *DISPLAYS)
    if name != "neighbour_time"
)
"""Options of `ciir convert`."""
_GROUPS = {
    "planes and disparity": FOCUS,
    "the lens array, and how the file stores the light field": READING,
    "raw lenslet pictures": LENSLET,
    "output": UPSCALING,
    "meshes": MESH,
    "videos and epipolar plane images": WRITING,
    "pictures for displays": DISPLAYS,
}
"""Headings in the help -> options."""


READING_VIEWS = tuple(name for name in (*READING, *LENSLET) if name not in ("pitch", "delta", "parallax"))
"""The options that say how the views of a light field lie in its file."""


def add_options(
    parser: argparse.ArgumentParser,
    names: Sequence[str],
    kind: KindName = "reconstruction",
    texts: Mapping[str, str] | None = None,
) -> None:
    """Adds options of `service.pipeline.options`, with the help in `texts`, or else the help for that kind of job."""
    headings = {name: heading for heading, group in _GROUPS.items() for name in group}
    if kind == "plane":
        headings["disparity"] = "planes and disparity"
    groups: dict[str, Any] = {}
    for name in names:
        option = OPTIONS[name]
        words: dict[str, Any] = {"metavar": option.placeholder}
        if option.flag:
            words = {"action": "store_const", "const": option.flag}
        heading = headings[name]
        if heading not in groups:
            groups[heading] = parser.add_argument_group(heading)
        groups[heading].add_argument(
            f"--{name.replace('_', '-')}",
            help=(texts or KINDS[kind].help).get(name, option.help).removeprefix(f"{option.flag}: "),
            default=argparse.SUPPRESS,
            dest=f"option_{name}",
            **words,
        )


def _add_raw_files(parser: argparse.ArgumentParser, names: Sequence[str] = ("white", "dark", "show-grid")) -> None:
    """Adds the files that go with a raw lenslet picture."""
    texts = {
        "white": "a picture of a white surface, used to find the lens grid and to even out the lenses' brightness",
        "dark": "a picture taken without light, which is subtracted",
        "show-grid": "write the picture with the lens grid drawn over it to this PNG",
    }
    for name in names:
        parser.add_argument(f"--{name}", metavar="FILE", help=f"with --lens-pitch: {texts[name]}")


def _add_report(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--report", metavar="FILE", help="also write the report (JSON) to this file")


def add_batch(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    """Adds `batch`. `add_command` is the function in `service.cli.parser`."""
    command = add_command(
        "batch",
        "reconstruct many inputs, on all cores of this machine or on a cluster",
        more="Inputs that already have outputs, made from the same content with the same options, are not done again. "
        "Exit status 3 means that some failed; summary.json and summary.csv say which, and why.",
    )
    command.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="files, globs, folders, scene:NAME, or URLs such as s3://BUCKET/FOLDER; videos with --lenses or "
        "--arrangement",
    )
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for the outputs, or its URL")
    command.add_argument(
        "--name",
        default="{path}",
        metavar="PATTERN",
        help="name of each output, which may contain {path}, {name}, {stem}, {suffix} or {number} of its input: a "
        "folder, or a file if it ends with a suffix, such as '{path}.png' (default {path}; for a video, a video)",
    )
    command.add_argument(
        "--sets", action="store_true", help="take each folder as one input: a set of views, or a mesh and its textures"
    )
    command.add_argument(
        "--workers", metavar="N", help="number of worker processes with one thread each (default: one for each core)"
    )
    command.add_argument(
        "--worker-memory", metavar="SIZE", help="memory for each worker process, such as 2GiB (default: an equal share)"
    )
    command.add_argument("--cluster", metavar="ADDRESS", help="use the workers of this Dask scheduler, tcp://HOST:PORT")
    add_options(command, KINDS["reconstruction"].options)
    _add_raw_files(command, names=("white", "dark"))


def add_pictures(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    """Adds the commands. `add_command` is the function in `service.cli.parser`."""
    _add_reconstruct(add_command)
    _add_convert(add_command)
    _add_refocus(add_command)
    _add_depth(add_command)
    _add_elemental(add_command)
    _add_upscale(add_command)


def _add_reconstruct(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command(
        "reconstruct",
        "make views of a mesh, an elemental image array or a set of views, and upscale them",
        "pictures.reconstruct",
    )
    command.add_argument(
        "input", metavar="INPUT", help="file, folder or zip; or scene:vase, scene:globe, scene:hamburger"
    )
    videos = [FORMATS[name].suffix for name in VIDEOS]
    command.add_argument(
        "-o",
        "--out",
        required=True,
        metavar="OUT",
        help="a folder, a .zip or .npz file, or a picture for one view; "
        f"{', '.join(videos[:-1])} or {videos[-1]} for several times",
    )
    add_options(command, KINDS["reconstruction"].options)
    _add_raw_files(command)
    _add_report(command)


def _add_convert(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command(
        "convert", "write a light field, or all views of a mesh, in another format", "pictures.convert"
    )
    command.add_argument("input", metavar="INPUT", help="file, folder or zip; or scene:NAME")
    command.add_argument(
        "-o", "--out", required=True, metavar="OUT", help=f"a folder of views, or a file: {', '.join(WHOLE_BY_SUFFIX)}"
    )
    command.add_argument(
        "--to",
        metavar="FORMAT",
        help=f"one of {', '.join([FOLDER, *WHOLE])} (default: chosen by the name of OUT)",
    )
    add_options(command, CONVERSION, texts={**ONE_POSE, "model": MODEL_FIRST})
    _add_raw_files(command)
    _add_report(command)


def _add_refocus(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command(
        "refocus", "refocus a light field or a mesh: depth planes, or a picture sharp at all depths", "pictures.refocus"
    )
    command.add_argument("input", metavar="INPUT", help="file, folder or zip; or scene:NAME")
    command.add_argument(
        "-o",
        "--out",
        required=True,
        metavar="OUT",
        help=f"one plane: {', '.join(PLANE_BY_SUFFIX)}; a stack: a folder, or {', '.join(STACK_BY_SUFFIX)}",
    )
    add_options(command, KINDS["plane"].options, "plane")
    _add_raw_files(command)
    _add_report(command)


def _add_depth(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command(
        "depth",
        "estimate the disparity of a view (exact for a mesh), or make a 3D model of what the views show",
        "pictures.depth",
    )
    command.add_argument("input", metavar="INPUT", help="file, folder or zip; or scene:NAME")
    models = " or ".join(entry.suffix for entry in MODELS.values())
    command.add_argument(
        "-o",
        "--out",
        required=True,
        metavar="OUT",
        help=f"{', '.join(maps.BY_SUFFIX)}, with the confidence in a second file; or {models}: a coloured 3D model",
    )
    command.add_argument(
        "--to", metavar="FORMAT", help=f"one of {', '.join(maps.FORMATS)} (default: chosen by the name of OUT)"
    )
    add_options(command, KINDS["disparity"].options, "disparity")
    _add_raw_files(command)
    _add_report(command)


def _add_elemental(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("elemental", "render a mesh's elemental image array", "pictures.elemental")
    command.add_argument("input", metavar="MESH", help="mesh file, or a folder or zip with one, or scene:NAME")
    command.add_argument("-o", "--out", required=True, metavar="FILE", help=f"picture to write: {', '.join(SUFFIXES)}")
    add_options(command, KINDS["elemental"].options, "elemental")
    _add_report(command)


def _add_upscale(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("upscale", "upscale any picture, or a folder of pictures", "pictures.upscale")
    command.add_argument(
        "input", metavar="IMAGE_OR_FOLDER", help="PNG, TIFF, JPEG, WebP, PPM, PGM or BMP; 8 or 16 bit; grey, RGB, alpha"
    )
    command.add_argument("-o", "--out", required=True, metavar="OUT", help="a picture, or a folder")
    add_options(command, KINDS["upscale"].options, "upscale")
    _add_report(command)
