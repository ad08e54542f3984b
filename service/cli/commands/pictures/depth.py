"""`ciir depth`: writes the disparity of a view together with its confidence, or a 3D model of what the views show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.writers.depth import find_format, write_disparity
from ciir.renderer.writers.depth.maps import BY_SUFFIX, CONFIDENCE
from ciir.service.cli import common, output_path
from ciir.service.pipeline.focus.disparities import find_disparity
from ciir.service.pipeline.focus.models import build_model
from ciir.service.pipeline.options import KINDS, MODELS

if TYPE_CHECKING:
    import argparse

    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

_MODELS = tuple(entry.suffix for entry in MODELS.values())


def run(args: argparse.Namespace) -> None:
    """Writes the files, and prints a line about them."""
    path = Path(args.out)
    is_model = path.suffix.lower() in _MODELS and args.to is None
    if not is_model and args.to is None and path.suffix.lower() not in BY_SUFFIX:
        listed = ", ".join((*BY_SUFFIX, *_MODELS))
        raise InvalidOption(f"{path}: not the name of a disparity map or a 3D model; end it with {listed}")
    name = None if is_model else find_format(path, args.to).name
    made = path.suffix.lower().removeprefix(".") if is_model else name
    beside = None if is_model else path.with_stem(path.stem + CONFIDENCE)
    output_path.check_places(args, *([beside] if beside else []))
    options = common.parse_options(args, "disparity")
    KINDS["disparity"].check_format(options, made)
    source = common.open_input(args, options)
    report, what = _write_model(source, options, path) if name is None else _write_map(source, options, path, name)
    common.write_report(report, args.report)
    common.print_line(f"{args.out}: {what} ({common.format_timings(report)})")


def _write_map(source: Source, options: Options, path: Path, name: str) -> tuple[Report, str]:
    """Writes the map, and returns the report and a description of what was written."""
    with common.progress_bar("picture") as progress:
        found, report = find_disparity(source, options, progress=progress)
    described = report["disparity"]
    described |= write_disparity(path, found, name)
    size = f"{described['height']}x{described['width']} pixels; confidence in {described['confidence']}"
    return report, f"disparity of view {found.view[0]},{found.view[1]}, {_describe_range(described)}, {size}"


def _describe_range(described: Report) -> str:
    """Describes the range of disparities in the view."""
    found = described["confident"]
    if found is None:
        return "which has too little texture to tell"
    sure = f"(1st to 99th percentile) where texture has a confidence of {found['confidence']:.2g} or more"
    where = "where the mesh is seen" if described["exact"] else sure
    return f"{found['least']:.3f} to {found['largest']:.3f} {where}"


def _write_model(source: Source, options: Options, path: Path) -> tuple[Report, str]:
    with common.progress_bar("picture") as progress:
        model, report = build_model(source, options, progress=progress)
    is_points = options.points == "yes"
    model.save(path, points=is_points)
    surface = report["surface"]
    what = f"{surface['vertices']} points" if is_points else f"{surface['triangles']} triangles"
    return report, f"a 3D model of {what}"
