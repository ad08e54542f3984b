"""`ciir reconstruct`: the main job, from files to files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import BY_SUFFIX, BY_SUFFIX_OF_TIMES, FileWriter, check_options
from ciir.service.cli import common, output_path
from ciir.service.pipeline import run as pipeline

if TYPE_CHECKING:
    import argparse

    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source


def run(args: argparse.Namespace) -> None:
    """Writes the views and the report, and prints a line about them."""
    is_file = output_path.names_file(args.out, list(BY_SUFFIX), what="views")
    path = Path(args.out)
    output_path.check_places(args)
    common.check_report(args.report, path)
    options = common.parse_options(args)
    source = common.open_input(args, options)
    report = _to_file(source, options, path) if is_file else _to_folder(source, options, path, Path(args.input))
    common.write_report(report, args.report)
    views = report["views"]
    size = f"{views[0]['width']}x{views[0]['height']}"
    what = "frame" if "time" in views[0] else "view"
    common.print_line(
        f"{args.out}: {len(views)} {what}{'s' * (len(views) > 1)} of {size} pixels ({common.format_timings(report)})"
    )


def _to_file(source: Source, options: Options, path: Path) -> Report:
    suffix = path.suffix.lower()
    formats = BY_SUFFIX_OF_TIMES if len(options.time or ()) > 1 else BY_SUFFIX
    given = formats[suffix].name, options.make_writer_options(suffix)
    with replacing(path) as file, FileWriter(file, *given) as writer, common.progress_bar("view") as progress:
        return pipeline.reconstruct(source, options, writer, progress=progress)


def _to_folder(source: Source, options: Options, path: Path, given: Path) -> Report:
    check_options(options.make_writer_options(), (), "a folder of views")
    with FolderWriter(path, given) as writer, common.progress_bar("view") as progress:
        return pipeline.reconstruct(source, options, writer, progress=progress)
