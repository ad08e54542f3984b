"""Finds out what an input is before it is processed: its kind, its sizes, and the lens grids that it may have."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.readers import inputs
from ciir.renderer.readers.registry import PictureFormat
from ciir.renderer.scene import Scene
from ciir.service.pipeline.inspection.pictures import describe_picture
from ciir.service.pipeline.report import Clock, Report, find_versions
from ciir.service.pipeline.source import Input, make_layout

if TYPE_CHECKING:
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.source import Source


def inspect(source: Source, options: Options, clock: Clock | None = None) -> Report:
    """Returns the report of an inspection. Views of a set are not decoded, and nothing is rendered.

    `kind`: mesh or views; for one picture eia, mosaic or raw, or picture if no lenses are found. `candidates`: what a
    picture whose lenses are not given may be, the likeliest first, each with the `options` that read it that way.

    Raises `InputError`.
    """
    clock = clock or Clock()
    given = Input(source)
    with clock.stage("decode"):
        picture = _find_picture(given, options)
        found = _describe_content(given, options) if picture is None else describe_picture(given, *picture, options)
    return found | {"versions": find_versions(), "timings_ms": clock.timings_ms()}


def _find_picture(given: Input, options: Options) -> tuple[PictureFormat, str] | None:
    """Finds the picture whose lens grid is to be found; None for another input, or if options say what it is."""
    bundle = given.bundle
    if bundle is None or options.lenses is not None or (options.pixels is not None and options.known_grid is None):
        return None
    is_raw = options.known_grid is not None
    found = inputs.find_picture(bundle) if is_raw else inputs.find_content(bundle, make_layout(options))
    if found is None or not isinstance(found[0], PictureFormat):
        return None
    return None if not is_raw and inputs.holds_views(bundle, make_layout(options)) else (found[0], found[1])


def _describe_content(given: Input, options: Options) -> Report:
    content = given.open(options, views="center")
    report: Report = {"input": given.describe(content), "candidates": [], "notes": [*content.notes]}
    if isinstance(content, Scene):
        return {"kind": "mesh", **report, "bounds": content.bounds().tolist()}
    pixels_v, pixels_u, rows, cols, _ = content.shape
    kind = "views"
    if given.bundle is not None and not inputs.holds_views(given.bundle, make_layout(options)):
        kind = "eia" if content.depth_sense == "lenses" else "mosaic"
    view = {"rows": pixels_v, "cols": pixels_u, "height": rows, "width": cols, "depth_sense": content.depth_sense}
    return {"kind": kind, **report, "light_field": view}
