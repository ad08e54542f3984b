"""`ciir convert` to pictures for displays."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from ciir.errors import InvalidOption
from ciir.renderer.displays.integral import parse_display
from ciir.renderer.displays.lenticular import parse_calibration
from ciir.renderer.displays.panel import Conversion
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.readers.bundle import read_file
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.pictures import SUFFIXES, encode
from ciir.service.cli import common, output_path
from ciir.service.cli.display_arguments import KINDS
from ciir.service.pipeline.displays.pictures import make_picture
from ciir.service.pipeline.displays.quilts import resolve_quilt
from ciir.service.pipeline.limits import read_limits
from ciir.service.pipeline.options.values import make_number
from ciir.service.pipeline.source import open_source

if TYPE_CHECKING:
    import argparse

    from ciir.renderer.displays.quilt import QuiltLayout
    from ciir.service.pipeline.displays.pictures import Target


def write_picture(args: argparse.Namespace, kind: str) -> None:
    """Writes the picture, beside a quilt its layout, and prints a line about it."""
    path = Path(args.out)
    if path.suffix.lower() not in SUFFIXES:
        given = [f"--{name}" for name in KINDS[kind] if getattr(args, name) is not None]
        other = f", or leave {', '.join(given)} out" if args.to is None else ""
        raise InvalidOption(
            f"{args.out}: a {kind} is written as a picture; end the name with one of {', '.join(SUFFIXES)}{other}"
        )
    if kind != "quilt" and path.suffix.lower() in (".jpg", ".jpeg"):
        raise InvalidOption(f"{args.out}: JPEG mixes the subpixels that lenses tell apart; end the name with .png")
    output_path.check_not_input([args.out, args.report], args.input)
    common.check_report(args.report, path)
    conversion: Conversion = args.conversion or "spoc"
    if conversion not in get_args(Conversion):
        raise InvalidOption(f"--conversion: {conversion[:40]!r} is not known; give {' or '.join(get_args(Conversion))}")
    disparity = 0.0 if args.disparity is None else _read_number("disparity", args.disparity, -1000, 1000)
    target = _find_target(args, kind)
    options, source = common.parse_options(args), open_source(args.input)
    with common.progress_bar("row" if kind != "quilt" else "view") as progress:
        picture, layout, report = make_picture(
            source,
            options,
            target,
            is_placed=hasattr(args, "option_place"),
            conversion=conversion,
            disparity=disparity,
            progress=progress,
        )
    data = encode(picture, path.suffix.lower())
    if layout is not None:
        path = _name_quilt(path, layout, report["notes"])
        output_path.check_not_input([path], args.input)
    with replacing(path) as file:
        file.write(data)
    if layout is not None:
        with replacing(path.with_name(f"{path.name}.json")) as file:
            file.write(layout.to_json().encode())
    common.write_report(report, args.report)
    size = f"{picture.shape[1]}x{picture.shape[0]}"
    what = f"quilt of {layout.cols}x{layout.rows} views" if layout is not None else f"{kind} picture"
    common.print_line(f"{path}: {what}, {size} pixels ({common.format_timings(report)})")


def _find_target(args: argparse.Namespace, kind: str) -> Target:
    """What the picture is for."""
    if kind == "quilt":
        return resolve_quilt(
            named=parse_name(Path(args.out).name),
            device=args.device,
            grid=None if args.quilt is None else _read_grid(args.quilt),
            aspect=None if args.aspect is None else _read_number("aspect", args.aspect, 0.01, 100),
        )
    limits = read_limits()
    given = args.calibration if kind == "lenticular" else args.display
    if given is None:
        remedy = (
            "--calibration FILE, the JSON file that the display holds"
            if kind == "lenticular"
            else "--display FILE, a TOML file as in docs/displays.md"
        )
        raise InvalidOption(f"--to {kind}: nothing is known of the display; give {remedy}")
    path = Path(given)
    data = read_file(path, limits)
    parse = parse_calibration if kind == "lenticular" else parse_display
    return parse(data, name=path.name, max_pixels=limits.pixels)


def _name_quilt(path: Path, layout: QuiltLayout, notes: list[str]) -> Path:
    """The quilt's own name, which holds its layout: displays read it there."""
    if parse_name(path.name) is not None:
        return path
    named = path.with_name(f"{path.stem}{layout.suffix}{path.suffix}")
    notes.append(f"named {named.name}: displays read columns, rows and aspect from the name")
    return named


def _read_grid(text: str) -> tuple[int, int]:
    """`8x6`, columns x rows."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX]\s*(\d{1,6})\s*", text)
    if match is None:
        raise InvalidOption(f"--quilt: {text[:40]!r} is not understood; give columns x rows of views, such as 8x6")
    return int(match[1]), int(match[2])


def _read_number(name: str, text: str, low: float, high: float) -> float:
    kind = make_number(low, high)
    value: float = kind.read(f"--{name}", text)
    kind.check(f"--{name}", value)
    return value
