"""`ciir convert` for pictures for displays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.displays.pictures import USES, describes_print
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.writers import formats
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.pictures import encode
from ciir.service.cli import common, output_path
from ciir.service.pipeline.displays.pictures import make_picture

if TYPE_CHECKING:
    import argparse

    from ciir.renderer.displays.pictures import Kind
    from ciir.renderer.displays.quilt import QuiltLayout
    from ciir.service.pipeline.options import Options


def find_display(args: argparse.Namespace, options: Options) -> Kind | None:
    """Returns the kind of display picture that is asked for, or None for another format."""
    if args.to is not None:
        return next((kind for kind in USES if kind == args.to), None)
    return formats.find_display(Path(args.out), options)


def write_picture(args: argparse.Namespace, options: Options, kind: Kind) -> None:
    """Writes the picture, for a quilt also its layout, and prints a line about it."""
    path = Path(args.out)
    suffixes = formats.FORMATS[kind].suffixes
    if path.suffix.lower() not in suffixes:
        given = [f"--{name.replace('_', '-')}" for name in USES[kind] if hasattr(args, f"option_{name}")]
        other = f", or leave {', '.join(given)} out" if args.to is None else ""
        what = "a print" if kind == "lenticular" and describes_print(options) else f"a {kind}"
        raise InvalidOption(
            f"{args.out}: {what} is written as {', '.join(suffixes)}; end the name with one of them{other}"
        )
    named = parse_name(path.name)
    output_path.check_places(args, *([_place_layout(path)] if named is not None else []))
    source = common.open_input(args, options)
    with common.progress_bar("row" if kind != "quilt" else "view") as progress:
        picture, report = make_picture(
            source, options, kind, named=named, suffix=path.suffix.lower(), progress=progress
        )
        data = encode(picture.pixels, path.suffix.lower(), ppi=picture.ppi)
    layout = picture.layout
    if layout is not None:
        path = _name_quilt(path, layout, report["notes"])
        if path != Path(args.out):
            output_path.check_places(args, path, _place_layout(path))
    with replacing(path) as file:
        file.write(data)
    if layout is not None:
        with replacing(_place_layout(path)) as file:
            file.write(layout.to_json().encode())
    common.write_report(report, args.report)
    size = f"{picture.pixels.shape[1]}x{picture.pixels.shape[0]}"
    what = f"quilt of {layout.cols}x{layout.rows} views" if layout is not None else f"{kind} picture"
    common.print_line(f"{path}: {what}, {size} pixels ({common.format_timings(report)})")


def _place_layout(path: Path) -> Path:
    """Returns the path of the JSON with the layout of the quilt at `path`."""
    return path.with_name(f"{path.name}.json")


def _name_quilt(path: Path, layout: QuiltLayout, notes: list[str]) -> Path:
    """Returns the path with the quilt's layout in its name, where displays read it."""
    if parse_name(path.name) is not None:
        return path
    named = path.with_name(f"{path.stem}{layout.suffix}{path.suffix}")
    notes.append(f"named {named.name}: displays read columns, rows and aspect from the name")
    return named
