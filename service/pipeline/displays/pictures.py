"""Makes pictures for displays."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.displays.depth_budget import (
    describe_light_field,
    describe_row,
    measure_integral,
    measure_lenticular,
    measure_quilt,
)
from ciir.renderer.displays.integral import IntegralDisplay
from ciir.renderer.displays.lenticular import Calibration, interlace
from ciir.renderer.displays.light_fields import make_quilt, order_as_cameras, pad_to_aspect, take_row
from ciir.renderer.displays.panel import Conversion, render_panel, resample_panel
from ciir.renderer.displays.progress import Progress, ignore_progress
from ciir.renderer.displays.quilt import join_views
from ciir.renderer.displays.rays import RayCaster
from ciir.renderer.displays.screen import Screen
from ciir.renderer.framing import frame_scene
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers.quilts import find_layout
from ciir.renderer.readers.view_set.view_files import ViewFiles
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.renderer.scene import Scene
from ciir.service.pipeline.displays.quilts import Quilt
from ciir.service.pipeline.options import MESH
from ciir.service.pipeline.options.options import Options
from ciir.service.pipeline.report import Clock, find_versions
from ciir.service.pipeline.source import Input
from ciir.service.pipeline.stages.object_check import ObjectCheck

if TYPE_CHECKING:
    from ciir.renderer.displays.quilt import QuiltLayout
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

SAMPLES = 2
"""Rays along each side of a pixel; `LENSLET_SAMPLES` with the sampling `lenslet`."""
NATIVE_VIEWS = 48
"""Views that a light field with fewer gets for a native picture."""


Target = Quilt | Calibration | IntegralDisplay


def make_picture(
    source: Source,
    options: Options,
    target: Target,
    *,
    is_placed: bool = True,
    conversion: Conversion = "spoc",
    disparity: float = 0.0,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> tuple[Pixels, QuiltLayout | None, Report]:
    """The picture `(height, width, 1 or 3)` for `target`, a quilt's layout as it came to be, and the report.

    A mesh is cast ray by ray; where `is_placed` is False it stands astride the display's plane. `conversion`: of
    panels. `disparity`: of a light field, what lies in the display's plane, in pixels from view to view, larger where
    it is nearer.

    Raises `InputError`.
    """
    clock = clock or Clock()
    given = Input(source)
    with clock.stage("decode"):
        opened = given.open(options, views="all")
        content = _load_views(opened, target) if isinstance(opened, ViewFiles) else opened
    if isinstance(content, Scene) and not is_placed:
        options = replace(options, place=0.0)
    _check_options(given.name, content, options, disparity)
    layout = target.layout if isinstance(target, Quilt) else None
    notes = [*(() if isinstance(target, IntegralDisplay) else target.notes), *content.notes]
    matrix = None
    with clock.stage("render" if isinstance(content, Scene) else "map"):
        if isinstance(content, Scene):
            matrix = frame_scene(content, _find_array(target), options.placement)
            picture, found = _render(content.transform(matrix), options, target, conversion, progress)
        elif isinstance(target, Quilt):
            picture, layout, found = make_quilt(
                content,
                target.layout,
                own_aspect=_find_aspect(source, content),
                keeps_aspect=target.keeps_aspect,
                disparity=disparity,
                max_pixels=given.limits.pixels,
            )
        else:
            picture, found = _resample(
                content,
                target,
                aspect=_find_aspect(source, content),
                conversion=conversion,
                disparity=disparity,
                progress=progress,
            )
    report: Report = {
        "input": given.describe(opened),
        "display": _describe(replace(target, layout=layout) if isinstance(target, Quilt) and layout else target),
        "scene_transform": None if matrix is None else matrix.tolist(),
        "options": options.as_dict(),
        "notes": [*notes, *found],
        "timings_ms": clock.timings_ms(),
        "versions": find_versions(*(("embreex",) if matrix is not None else ())),
    }
    return picture, layout, report


def _load_views(views: ViewFiles, target: Target) -> LightField:
    """The views that the display shows: of a lenticular one the row that `take_row` takes."""
    if not isinstance(target, IntegralDisplay):
        rows = views.shape[0]
        middle = (rows - 1) // 2 if views.depth_sense == "cameras" else rows // 2
        views = replace(views, files=views.files[middle : middle + 1])
    return views.load()


def _check_options(name: str, content: Scene | LightField, options: Options, disparity: float) -> None:
    """Raises `InvalidOption` for an option that is for the other kind of input, or that the display settles."""
    is_mesh = isinstance(content, Scene)
    for option in ("lenses", "pixels", "pitch", "delta", "parallax", "pickup", "order") if is_mesh else MESH:
        if getattr(options, option) != getattr(Options, option):
            why = "the display gives it" if is_mesh else f"this is for meshes and {name} holds pictures"
            raise InvalidOption(f"{option}: {why}; leave it out")
    if is_mesh and disparity:
        raise InvalidOption(f"disparity: this is for light fields and {name} is a mesh; give place")
    if options.backend == "raster":
        raise InvalidOption("backend: pictures for displays are cast by rays; leave it out or give raytrace")


def _find_array(target: Target) -> LensArray:
    """The lens array that a mesh is framed for."""
    return target.lens_array() if isinstance(target, IntegralDisplay) else _find_screen(target).lens_array()


def _find_screen(target: Quilt | Calibration) -> Screen:
    return Screen(target.layout.aspect if isinstance(target, Quilt) else target.aspect, target.cone)


def _render(
    scene: Scene, options: Options, target: Target, conversion: Conversion, progress: Progress
) -> tuple[Pixels, tuple[str, ...]]:
    """The picture of a mesh that stands at the display, and notes on its depth."""
    check = ObjectCheck(options.background)
    caster = RayCaster(scene, options.background, check.add)
    samples = LENSLET_SAMPLES if options.sampling == "lenslet" else SAMPLES
    if isinstance(target, IntegralDisplay):
        panel = render_panel(caster, target, conversion=conversion, samples=samples, progress=progress)
        return panel, (*measure_integral(scene, target).notes(), *caster.notes(), *check.list_notes())
    screen = _find_screen(target)
    if isinstance(target, Calibration):
        native = screen.render_native(caster, target, progress=progress)
        budget = measure_lenticular(scene, screen, target)
        return native, (*budget.notes(), *caster.notes(), *check.list_notes())
    count = target.layout.count
    views = np.empty((count, *target.tile, 3), np.uint8)
    for index, view in enumerate(screen.render_views(caster, count, target.tile, samples=samples)):
        views[index] = view
        progress(index + 1, count)
    budget = measure_quilt(scene, screen, count, target.tile[1])
    return join_views(views, target.layout), (*budget.notes(), *caster.notes(), *check.list_notes())


def _find_aspect(source: Source, light_field: LightField) -> float:
    """Width / height that the views are shown with. Only quilts have pixels that are not square."""
    layout = find_layout(source, source.main) if isinstance(source, Bundle) and source.main else None
    height, width = light_field.views.shape[2:4]
    is_quilt = layout is not None and light_field.views.shape[:2] == (1, layout.count)
    return layout.aspect if layout is not None and is_quilt else width / height


def _resample(
    light_field: LightField,
    target: Calibration | IntegralDisplay,
    *,
    aspect: float,
    conversion: Conversion,
    disparity: float,
    progress: Progress,
) -> tuple[Pixels, tuple[str, ...]]:
    """The picture of a light field whose views are shown with `aspect`, and notes."""
    cameras = order_as_cameras(light_field)
    if isinstance(target, IntegralDisplay):
        panel = resample_panel(cameras, target, conversion=conversion, disparity=disparity, progress=progress)
        return panel, describe_light_field(cameras, target, disparity)
    count = max(NATIVE_VIEWS, cameras.shape[1])
    row, notes = take_row(cameras, count, disparity=disparity)
    notes += describe_row(cameras, count, disparity)
    row, padded = pad_to_aspect(row, aspect, target.aspect)
    return interlace(row, target, progress=progress), (*notes, *padded)


def _describe(target: Target) -> Report:
    """The report's `display`."""
    kind = {Quilt: "quilt", Calibration: "lenticular", IntegralDisplay: "panel"}[type(target)]
    numbers = {key: None if value == math.inf else value for key, value in asdict(target).items() if key != "notes"}
    return {"kind": kind, **numbers}
