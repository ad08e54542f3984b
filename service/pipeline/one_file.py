"""Runs a job of any kind from an upload to one file, as worker processes do.

Modules that only some kinds of jobs need are imported when they run: SciPy and Embree take 150 MB of address space.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from functools import partial
from typing import IO, TYPE_CHECKING, cast

from ciir.errors import InvalidOption, UnsupportedType
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import READ, SUFFIXES, ZIP, MeshFormat, PictureFormat
from ciir.renderer.writers.depth import encode_disparity
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import BY_SUFFIX, FORMATS, encode_png
from ciir.renderer.writers.stacks import PLANE, STACK
from ciir.renderer.writers.writer import REPORT, ZIP_DATE, report_json
from ciir.service.pipeline import run
from ciir.service.pipeline.elemental import encode_eia, render_eia
from ciir.service.pipeline.options import MODELS, find_plane_format
from ciir.service.pipeline.pictures import output_names, upscale_files
from ciir.service.pipeline.source import SCENE

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.displays.pictures import Kind as DisplayKind
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.pipeline.options import KindName, Options
    from ciir.service.pipeline.report import Clock, Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source

    Run = Callable[[Source, "Options", "Output"], tuple[str, "Report"]]
    """Returns the name of the format that was written, and the report. Raises the same errors as
    `service.pipeline.run`."""

_TAKEN: dict[KindName, str] = {
    "upscale": ", ".join(suffix for suffix, entry in SUFFIXES.items() if isinstance(entry, PictureFormat)),
    "elemental": ", ".join(
        suffix for suffix, entry in SUFFIXES.items() if isinstance(entry, MeshFormat) or entry is ZIP
    ),
}
"""The file suffixes for the kinds that don't take all files."""


@dataclass(frozen=True)
class Output:
    """Where a job's result is written, and what limits and measures its work."""

    file: IO[bytes]
    format: str | None
    """One of the kind's formats, or None for its default."""
    max_pixels: int
    """Most output pixels, and most samples of a mesh."""
    progress: Progress
    clock: Clock


def open_upload(kind: KindName, name: str, data: bytes, limits: Limits) -> Source:
    """Opens an upload like `Bundle.from_upload`, or a shipped scene. `UnsupportedType` lists what the kind takes."""
    if name.startswith(SCENE):
        return name.removeprefix(SCENE)
    try:
        return Bundle.from_upload(name, data, limits)
    except UnsupportedType as error:
        raise UnsupportedType(str(error).replace(READ, _TAKEN.get(kind, READ))) from error


def _reconstruct(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    with FileWriter(output.file, output.format, options.make_writer_options()) as writer:
        report = run.reconstruct(
            source, options, writer, max_pixels=output.max_pixels, progress=output.progress, clock=output.clock
        )
    return writer.format.name, report


def _upscale(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    assert isinstance(source, Bundle)  # noqa: S101 - the kind takes no scenes
    if source.main is None:
        raise InvalidOption(
            f"{source.name}: this holds several files; send one picture, or send views to a reconstruction"
        )
    name = (
        output_names([source.main])[source.main] if output.format is None else f"upload{FORMATS[output.format].suffix}"
    )
    report = upscale_files(
        source.files,
        {source.main: name},
        lambda _, data: output.file.write(data),
        model=options.model,
        scale=options.scale,
        skip=options.skip == "exact",
        limits=source.limits,
        max_pixels=output.max_pixels,
        progress=output.progress,
        clock=output.clock,
    )
    return BY_SUFFIX[name[name.rindex(".") :]].name, report


def _render_eia(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    name = output.format or "png"

    def keep(pixels: Pixels) -> None:
        output.file.write(encode_eia(pixels, options, FORMATS[name].suffix))

    return name, render_eia(
        source, options, keep, max_pixels=output.max_pixels, progress=output.progress, clock=output.clock
    )


def _show(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    from ciir.service.pipeline.displays.pictures import make_picture

    kind = cast("DisplayKind | None", output.format)
    picture, report = make_picture(
        source, options, kind, max_pixels=output.max_pixels, progress=output.progress, clock=output.clock
    )
    with output.clock.stage("encode"):
        output.file.write(encode_png(picture.pixels, ppi=picture.ppi))
    return report["display"]["kind"], report | {"timings_ms": output.clock.timings_ms()}


def _refocus(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    from ciir.service.pipeline.focus.planes import refocus

    name = find_plane_format(options, output.format)
    writers = PLANE if options.count_planes() == 1 else STACK
    report = refocus(
        source,
        options,
        partial(writers[name], output.file),
        max_pixels=output.max_pixels,
        progress=output.progress,
        clock=output.clock,
    )
    return name, report


def _find_disparity(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    name = output.format or "pfm"
    if name in MODELS:
        from ciir.renderer.focus.model import encode_model
        from ciir.service.pipeline.focus.models import build_model

        model, report = build_model(
            source, options, max_pixels=output.max_pixels, progress=output.progress, clock=output.clock
        )
        output.file.write(encode_model(model, MODELS[name].suffix, points=options.points == "yes"))
        return name, report
    from ciir.service.pipeline.focus.disparities import find_disparity

    found, report = find_disparity(
        source, options, max_pixels=output.max_pixels, progress=output.progress, clock=output.clock
    )
    with output.clock.stage("encode"):
        data, confidence, reading = encode_disparity(found, "pfm" if name == "zip" else name)
        report["disparity"] |= reading
        if name != "zip":
            output.file.write(data)
            return name, report
        picture, _, _ = encode_disparity(found, "viridis")
        files = {"disparity.pfm": data, "confidence.pfm": confidence, "disparity.png": picture}
        with zipfile.ZipFile(output.file, "w") as archive:
            for each, content in {**files, REPORT: report_json(report)}.items():
                archive.writestr(zipfile.ZipInfo(each, ZIP_DATE), content, zipfile.ZIP_DEFLATED)
    return name, report


def _inspect(source: Source, options: Options, output: Output) -> tuple[str, Report]:
    from ciir.service.pipeline.inspection.report import inspect

    report = inspect(source, options, output.clock)
    output.file.write(report_json(report))
    return "json", report


RUNS: dict[KindName, Run] = {
    "reconstruction": _reconstruct,
    "upscale": _upscale,
    "elemental": _render_eia,
    "display": _show,
    "plane": _refocus,
    "disparity": _find_disparity,
    "inspection": _inspect,
}
"""The function that runs each kind."""
