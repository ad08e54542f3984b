"""`ciir upscale`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from renderer import pictures
from renderer.errors import InvalidOption
from service.atomic import Staged, replacing
from service.commands import common
from service.upscaling import output_names, upscale_pictures

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from renderer.bundle import Bundle
    from service.report import Report
    from service.request import Options


def run(args: argparse.Namespace) -> None:
    """Writes the upscaled pictures, and the report where one is asked for."""
    options, bundle = common.options(args), common.bundle(args.input)
    out = Path(args.out)
    if bundle.main is None:
        names = [name for name in bundle.files if _is_picture(name) and "/" not in name]
        left_out = [name for name in bundle.files if name not in names]
        if not names:
            raise InvalidOption(f"{args.input}: no picture in it; give PNG, TIFF or JPEG files")
        report = _folder(bundle, output_names(names), out, options)
        report["notes"] = [f"left out, not a picture of this folder: {name}" for name in left_out]
    elif _is_picture(out.name) and not out.is_dir():
        report = _single(bundle, bundle.main, out, options)
    else:
        report = _folder(bundle, output_names([bundle.main]), out, options)
    common.write_report(report, args.report)
    done = report["pictures"]
    common.say(f"{args.out}: {len(done)} picture{'s' * (len(done) > 1)} ({common.timings(report)})")


def _is_picture(name: str) -> bool:
    return Path(name).suffix.lower() in pictures.SUFFIXES


def _single(bundle: Bundle, name: str, out: Path, options: Options) -> Report:
    with replacing(out) as file:

        def write(_: str, data: bytes) -> None:
            file.write(data)

        return upscale_pictures(bundle.files, {name: out.name}, write, model=options.model, scale=options.scale)


def _folder(bundle: Bundle, outputs: Mapping[str, str], out: Path, options: Options) -> Report:
    count, close = common.bar("picture", total=len(outputs))
    staged = Staged(out)
    try:
        report = upscale_pictures(
            bundle.files, outputs, staged.write, model=options.model, scale=options.scale, progress=count
        )
        staged.commit()
    finally:
        staged.discard()
        close()
    return report
