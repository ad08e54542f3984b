"""`ciir upscale`: upscales a picture or a folder of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, UnsupportedType
from ciir.renderer.readers.registry import READ, is_picture
from ciir.renderer.writers.atomic_write import Staged, replacing
from ciir.renderer.writers.pictures import SUFFIXES
from ciir.service.cli import common, output_path
from ciir.service.pipeline.pictures import output_names, upscale_files
from ciir.service.pipeline.source import open_bundle

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from ciir.renderer.readers.bundle import Bundle
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.pictures import Write
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress

_TAKEN = ", ".join([*SUFFIXES, ".zip"]) + ", or a folder of such pictures"


def run(args: argparse.Namespace) -> None:
    """Writes the upscaled pictures, and the report where one is asked for."""
    path = Path(args.out)
    common.check_report(args.report, path)
    output_path.check_not_input([path, *common.list_report_paths(args.report)], args.input)
    options, bundle = common.parse_options(args), _bundle(args.input)
    if bundle.main is None:
        output_path.resolve_folder(args.out, what="several pictures")
        names = [name for name in bundle.files if is_picture(name) and "/" not in name]
        others = [name for name in bundle.files if name not in names]
        if not names:
            raise InvalidOption(f"{args.input}: no picture in it; give PNG, TIFF or JPEG files")
        report = _folder(bundle, output_names(names), path, options)
        report["notes"] = [f"not a picture in this folder, skipped: {name}" for name in others]
    elif output_path.names_file(args.out, SUFFIXES, what="a picture"):
        report = _single(bundle, bundle.main, path, options)
    else:
        outputs = output_names([bundle.main])
        output_path.check_not_input([path / name for name in outputs.values()], args.input)
        report = _folder(bundle, outputs, path, options)
    common.write_report(report, args.report)
    done = report["pictures"]
    common.print_line(f"{args.out}: {len(done)} picture{'s' * (len(done) > 1)} ({common.format_timings(report)})")


def _bundle(text: str) -> Bundle:
    try:
        return open_bundle(text)
    except UnsupportedType as error:  # its remedy lists meshes too
        raise UnsupportedType(str(error).replace(READ, _TAKEN)) from error


def _single(bundle: Bundle, name: str, path: Path, options: Options) -> Report:
    with replacing(path) as file:

        def write(_: str, data: bytes) -> None:
            file.write(data)

        return _upscaled(bundle, {name: path.name}, write, options)


def _folder(bundle: Bundle, outputs: Mapping[str, str], path: Path, options: Options) -> Report:
    staged = Staged(path)
    try:
        with common.progress_bar("picture") as progress:
            report = _upscaled(bundle, outputs, staged.write, options, progress)
        staged.commit()
    finally:
        staged.discard()
    return report


def _upscaled(
    bundle: Bundle, outputs: Mapping[str, str], write: Write, options: Options, progress: Progress | None = None
) -> Report:
    return upscale_files(
        bundle.files,
        outputs,
        write,
        model=options.model,
        scale=options.scale,
        skip=options.skip == "exact",
        progress=progress,
    )
