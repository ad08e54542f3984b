"""`ciir reconstruct`: the main job, from files to files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.renderer.writers.formats import BY_SUFFIX
from ciir.service import memory, outputs
from ciir.service.cli import common, output_path

if TYPE_CHECKING:
    import argparse


def run(args: argparse.Namespace) -> None:
    """Writes the views and the report, and prints a line about them."""
    memory.limit_heaps(memory.HEAPS)
    is_file = output_path.names_file(args.out, list(BY_SUFFIX), what="views")
    path = Path(args.out)
    output_path.check_places(args)
    options = common.parse_options(args)
    source = common.open_input(args, options)
    with common.progress_bar("view") as progress:
        if is_file:
            report = outputs.write_file(source, options, path, progress=progress)
        else:
            report = outputs.write_folder(source, options, path, given=Path(args.input), progress=progress)
    common.write_report(report, args.report)
    views = report["views"]
    size = f"{views[0]['height']}x{views[0]['width']}"
    what = "frame" if options.moments else "view"
    common.print_line(
        f"{args.out}: {len(views)} {what}{'s' * (len(views) > 1)} of {size} pixels ({common.format_timings(report)})"
    )
