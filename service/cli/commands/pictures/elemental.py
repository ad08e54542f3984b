"""`ciir elemental`: renders a mesh's elemental image array."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.formats import WHOLE_BY_SUFFIX
from ciir.renderer.writers.pictures import SUFFIXES
from ciir.service.cli import common, output_path
from ciir.service.pipeline.elemental import encode_eia, render_eia
from ciir.service.pipeline.source import open_source

if TYPE_CHECKING:
    import argparse

    from ciir.renderer.readers.pictures import Pixels


def run(args: argparse.Namespace) -> None:
    """Writes the elemental image array, and the report if one is asked for."""
    path = Path(args.out)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES or args.out.endswith("/"):
        listed = ", ".join(SUFFIXES)
        is_file = suffix in WHOLE_BY_SUFFIX and not args.out.endswith("/")
        other = f", or use `ciir convert`, which writes all views as {suffix}" if is_file else ""
        raise InvalidOption(f"{args.out or '-o'}: not a picture's name; end it with one of {listed}{other}")
    output_path.check_places(args)
    options, source = common.parse_options(args), open_source(args.input)
    with replacing(path) as file, common.progress_bar("view") as progress:

        def keep(pixels: Pixels) -> None:
            file.write(encode_eia(pixels, options, suffix))

        report = render_eia(source, options, keep, progress=progress)
    common.write_report(report, args.report)
    array = report["lens_array"]
    width, height = array["cols"] * array["pixels_u"], array["rows"] * array["pixels_v"]
    common.print_line(f"{args.out}: {width}x{height} pixels ({common.format_timings(report)})")
