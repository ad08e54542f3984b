"""`ciir convert`: writes a light field, or all views of a mesh, in another format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.writers.formats import FOLDER, WHOLE_BY_SUFFIX, find_implied, find_whole_format
from ciir.service import outputs
from ciir.service.cli import common, output_path
from ciir.service.cli.display_pictures import find_display, write_picture
from ciir.service.pipeline.options import NO_MODEL

if TYPE_CHECKING:
    import argparse


def run(args: argparse.Namespace) -> None:
    """Writes all views, as they are or upscaled, and prints a line about them."""
    options = common.parse_options(args, "display")
    if options.moments:
        (varied,) = options.moments[0]
        raise InvalidOption(
            f"{'rotate' if varied == 'yaw' else varied}: {len(options.moments)} {varied}s make a video of one view, "
            f"with `ciir reconstruct`; give one {varied} for `ciir convert`, which writes all views"
        )
    if options.model == NO_MODEL and hasattr(args, "option_scale"):
        raise InvalidOption(
            "scale: views are written as they are unless a model upscales them; give model auto too, or leave it out"
        )
    display = find_display(args, options)
    if display is not None:
        write_picture(args, options, display)
        return
    path = Path(args.out)
    name = _find_format(args.to or find_implied(path, options), args.out)
    output_path.check_places(args)
    options = replace(options, views="all")
    source = common.open_input(args, options)
    with common.progress_bar("view") as progress:
        if name is None:
            report = outputs.write_folder(source, options, path, given=Path(args.input), progress=progress)
        else:
            report = outputs.write_file(source, options, path, name, progress=progress)
    common.write_report(report, args.report)
    array = report["lens_array"]
    scale = report["plan"]["scale"]
    grid, size = f"{array['pixels_v']}x{array['pixels_u']}", f"{array['rows'] * scale}x{array['cols'] * scale}"
    what = "folder of views" if name is None else name
    common.print_line(f"{args.out}: {what}, {grid} views of {size} pixels ({common.format_timings(report)})")


def _find_format(wanted: str | None, out: str) -> str | None:
    """Returns the name of the format to write, or None for a folder of views."""
    if wanted is None or not out:
        is_file = output_path.names_file(out, list(WHOLE_BY_SUFFIX), what="a light field")
        return WHOLE_BY_SUFFIX[Path(out).suffix.lower()].name if is_file else None
    if wanted == FOLDER:
        if Path(out).suffix.lower() in WHOLE_BY_SUFFIX:
            output_path.resolve_folder(out, what="a folder of views")
        return None
    found = find_whole_format(wanted, Path(out))
    return None if found is None else found.name
