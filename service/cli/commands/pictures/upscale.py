"""`ciir upscale`: upscales a picture or a folder of pictures."""

from __future__ import annotations

from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, UnsupportedType
from ciir.renderer.readers.registry import READ, is_container, is_picture
from ciir.renderer.readers.registry import SUFFIXES as READ_SUFFIXES
from ciir.renderer.writers.atomic_write import Staged, replacing
from ciir.renderer.writers.pictures import SUFFIXES
from ciir.service.cli import common, output_path
from ciir.service.pipeline.pictures import output_names, upscale_files
from ciir.service.pipeline.source import SCENE, open_bundle

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Mapping

    from ciir.renderer.readers.bundle import Bundle
    from ciir.service.pipeline.report import Report

_PICTURES = "PNG, TIFF, JPEG, WebP, PPM, PGM or BMP files"
_TAKEN = (
    ", ".join([suffix for suffix in READ_SUFFIXES if is_picture(f"x{suffix}")] + [".zip"])
    + ", or a folder of such pictures"
)


def run(args: argparse.Namespace) -> None:
    """Writes the upscaled pictures, and the report if one is asked for."""
    path = Path(args.out)
    output_path.check_places(args)
    options, bundle = common.parse_options(args), _bundle(args.input)
    skip = options.skip == "exact"
    upscale = partial(
        upscale_files, bundle.files, model=options.model, scale=options.scale, skip=skip, limits=bundle.limits
    )
    if bundle.main is None:
        output_path.resolve_folder(args.out, what="several pictures")
        names = [name for name in bundle.files if is_picture(name) and "/" not in name]
        others = [name for name in bundle.files if name not in names]
        below = [name for name in others if is_picture(name)]
        if not names:
            remedy = f"a folder below it, such as {PurePosixPath(below[0]).parent}" if below else _PICTURES
            raise InvalidOption(f"{args.input}: no picture in it; give {remedy}")
        report = _folder(upscale, output_names(names), path)
        report["notes"] += [
            f"{'in a subfolder' if name in below else 'not a picture'}, skipped: {name}" for name in others
        ]
    elif output_path.names_file(args.out, SUFFIXES, what="a picture"):
        report = _single(upscale, bundle.main, path)
    else:
        outputs = output_names([bundle.main])
        output_path.check_places(args, *(path / name for name in outputs.values()))
        report = _folder(upscale, outputs, path)
    common.write_report(report, args.report)
    done = report["pictures"]
    common.print_line(f"{args.out}: {len(done)} picture{'s' * (len(done) > 1)} ({common.format_timings(report)})")


def _bundle(text: str) -> Bundle:
    if text.startswith(SCENE):
        raise InvalidOption(f"{text}: a scene is a mesh, not a picture; upscale its views with `ciir reconstruct`")
    if is_container(text):
        raise InvalidOption(
            f"{text}: this is not a picture file; `ciir convert` writes the views of a light field as pictures, and "
            "`ciir reconstruct` upscales them"
        )
    try:
        return open_bundle(text)
    except UnsupportedType as error:  # its remedy lists meshes too
        raise UnsupportedType(str(error).replace(READ, _TAKEN)) from error


def _single(upscale: Callable[..., Report], name: str, path: Path) -> Report:
    with replacing(path) as file, common.progress_bar("picture") as progress:

        def write(_: str, data: bytes) -> None:
            file.write(data)

        return upscale({name: path.name}, write, progress=progress)


def _folder(upscale: Callable[..., Report], outputs: Mapping[str, str], path: Path) -> Report:
    staged = Staged(path)
    try:
        with common.progress_bar("picture") as progress:
            report = upscale(outputs, staged.write, progress=progress)
        staged.commit()
    finally:
        staged.discard()
    return report
