"""`ciir depth`: writes the disparity of a view, and beside it the confidence."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.renderer.writers.depth import find_format, write_disparity
from ciir.renderer.writers.depth.maps import CONFIDENCE
from ciir.service.cli import common, output_path
from ciir.service.pipeline.focus.disparities import find_disparity

if TYPE_CHECKING:
    import argparse


def run(args: argparse.Namespace) -> None:
    """Writes both maps, and prints a line about them."""
    path = Path(args.out)
    name = find_format(path, args.to).name
    beside = path.with_stem(path.stem + CONFIDENCE)
    output_path.check_not_input([args.out, beside, args.report, args.show_grid], args.input)
    common.check_report(args.report, path)
    options = common.parse_options(args, "disparity")
    source = common.open_input(args, options)
    with common.progress_bar("picture") as progress:
        found, report = find_disparity(source, options, progress=progress)
    described = report["disparity"]
    described |= write_disparity(path, found, name)
    common.write_report(report, args.report)
    size = f"{described['height']}x{described['width']} pixels"
    values = f"disparity {described['least']:.3f} to {described['largest']:.3f} of view {found.view[0]},{found.view[1]}"
    common.print_line(
        f"{args.out}: {values}, {size}, beside it {described['confidence']} ({common.format_timings(report)})"
    )
