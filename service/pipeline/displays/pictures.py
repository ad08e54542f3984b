"""Makes display pictures."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import Progress, ignore_progress
from ciir.renderer.displays.depth_budget import (
    find_shrinking,
    frame_integral,
    frame_screen,
    measure_integral,
    measure_lenticular,
    measure_quilt,
)
from ciir.renderer.displays.devices import Quilt, match_views
from ciir.renderer.displays.integral import IntegralDisplay
from ciir.renderer.displays.lenticular import Calibration
from ciir.renderer.displays.light_fields import find_row
from ciir.renderer.displays.panel import render_panel
from ciir.renderer.displays.pictures import USES, DisplayPicture, find_kind, find_size, find_target, show_light_field
from ciir.renderer.displays.quilt import join_views
from ciir.renderer.displays.rays import RayCaster
from ciir.renderer.displays.screen import Screen
from ciir.renderer.framing import flatten, frame_scene
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Scene
from ciir.renderer.writers.formats import check_options
from ciir.renderer.writers.pictures import BY_SUFFIX
from ciir.service.pipeline.collection import collect_views
from ciir.service.pipeline.displays.rays import check_rays, count_rays, find_samples
from ciir.service.pipeline.job import check_kind
from ciir.service.pipeline.options import KINDS, NO_MODEL
from ciir.service.pipeline.options.options import Options
from ciir.service.pipeline.planning.plan import note_scale
from ciir.service.pipeline.report import Clock, find_versions
from ciir.service.pipeline.source import Input
from ciir.service.pipeline.stages.object_check import ObjectCheck

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.displays.pictures import Kind, Target
    from ciir.renderer.displays.quilt import QuiltLayout, QuiltName
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.readers.view_set.view_files import ViewFiles
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Content, Source


def make_picture(
    source: Source,
    options: Options,
    kind: Kind | None = None,
    *,
    named: QuiltName | None = None,
    suffix: str = ".png",
    max_pixels: int | None = None,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> tuple[DisplayPicture, Report]:
    """Makes the picture for the display that `options` describe. Returns it with the report.

    A light field's views are upscaled first if `options` name a model. A mesh is cast ray by ray. Without `place` it is
    centred on the display's plane; with `fit` none it keeps its own place.

    `kind`: by default the one that the options are for. `named`: the layout in a quilt's name. `suffix`: that of the
    picture's file, whose format must be able to hold it. `max_pixels`: most pixels of the picture and of the upscaled
    views, and most rays.

    Raises `InputError`.
    """
    clock = clock or Clock()
    given = Input(source)
    kind = kind or find_kind(options)
    most = given.limits.pixels if max_pixels is None else min(given.limits.pixels, max_pixels)
    check_options(options, USES[kind], f"format {kind}")
    target = find_target(kind, options, named=named, max_pixels=most)
    with clock.stage("decode"):
        opened = given.open(options, views="all")
    _check_options(given.name, opened, options, target)
    matrix = None
    if isinstance(opened, Scene):
        BY_SUFFIX[suffix].check(find_size(target), np.dtype(np.uint8))
        made: Report = {"notes": opened.notes, "versions": find_versions("embreex")}
        if options.place is None and options.fit != "none":
            options = replace(options, place=0.0)
        check_rays(count_rays(target, options), max_pixels, options)
        with clock.stage("render"):
            matrix = _place_scene(opened, options, target)
            picture = _render(opened.transform(matrix), options, target, progress)
    else:
        if isinstance(target, Quilt):
            target = match_views(target, opened.shape[1], _find_aspect(opened))
        scale = 1 if options.model == NO_MODEL else options.scale
        size = opened.shape[2] * scale, opened.shape[3] * scale
        BY_SUFFIX[suffix].check(find_size(target, size, _find_aspect(opened), most), opened.dtype)
        if options.model == NO_MODEL:
            with clock.stage("decode"):
                light_field = _load_views(opened, target)
            made = {"notes": [*light_field.notes, *note_scale(options.scale)], "versions": find_versions()}
        else:
            wanted = replace(options, views=_name_views(opened, target))
            light_field, made = collect_views(
                source, wanted, crops_rows=True, max_pixels=max_pixels, progress=progress, clock=clock
            )
        with clock.stage("map"):
            picture = show_light_field(light_field, target, options, max_pixels=most, progress=progress)
    report: Report = {
        "input": given.describe(opened),
        "display": _describe(
            kind, replace(target, layout=picture.layout) if isinstance(target, Quilt) and picture.layout else target
        ),
        "scene_transform": None if matrix is None else matrix.tolist(),
        **{name: made[name] for name in ("plan", "model") if name in made},
        "options": options.as_dict(KINDS["display"].options),
        "notes": [*target.notes, *made["notes"], *picture.notes],
        "timings_ms": clock.timings_ms(),
        "versions": made["versions"],
    }
    return picture, report


def _find_aspect(views: LightField | ViewFiles) -> float:
    """Returns the width / height that views are shown with."""
    return views.shape[3] / views.shape[2] * (views.pixel_aspect if isinstance(views, LightField) else 1.0)


def _find_row(views: LightField | ViewFiles, target: Target) -> int | None:
    """Returns the one row of views that the display shows, or None if it shows all of them."""
    return None if isinstance(target, IntegralDisplay) else find_row(views.shape[0], views.depth_sense)


def _load_views(views: LightField | ViewFiles, target: Target) -> LightField:
    """Loads the views that the display shows."""
    if isinstance(views, LightField):
        return views
    row = _find_row(views, target)
    return (views if row is None else replace(views, files=views.files[row : row + 1])).load()


def _name_views(views: LightField | ViewFiles, target: Target) -> str:
    """Returns the views that the display shows as the option `views`."""
    row = _find_row(views, target)
    return "all" if row is None else ";".join(f"{row},{u}" for u in range(views.shape[1]))


def _check_options(name: str, content: Content, options: Options, target: Target) -> None:
    """Raises `InvalidOption` for an option that is for the other kind of input, or that the display determines."""
    check_kind(name, content, options, is_upscaled=options.model != NO_MODEL)
    is_mesh = isinstance(content, Scene)
    for option in ("lenses", "pixels", "pitch", "delta", "parallax") if is_mesh else ():
        if getattr(options, option) is not None:
            raise InvalidOption(f"{option}: this is set by the display; leave it out")
    if is_mesh and options.model != NO_MODEL:
        raise InvalidOption(
            f"model: this is for light fields, and {name} is a mesh, whose pixels are all ray-traced; leave it out"
        )
    if is_mesh and options.disparity:
        raise InvalidOption(f"disparity: this is for light fields, and {name} is a mesh; give place instead")
    if options.backend == "raster":
        raise InvalidOption("backend: pictures for displays are ray-traced; leave it out or give raytrace")
    if is_mesh and isinstance(target, Calibration) and options.sampling != Options.sampling:
        raise InvalidOption("sampling: a native picture takes one ray for each subpixel; leave it out")


def _place_scene(scene: Scene, options: Options, target: Target) -> NDArray[np.float64]:
    """Returns the 4x4 matrix that places a mesh at the display, so that with a zoom of 1 nothing leaves the frame. A
    depth factor doesn't change the size.
    """
    matrix = frame_scene(scene, _find_array(target), replace(options.placement, depth_factor=1.0))
    if options.fit == "none" or scene.window is not None:
        return flatten(matrix, options.depth_factor)
    if isinstance(target, IntegralDisplay):
        frame = frame_integral(target)
    else:
        frame = frame_screen(_find_screen(target), target.layout.count if isinstance(target, Quilt) else 2)
    factor = find_shrinking(scene.transform(matrix), frame, options.zoom)
    return flatten(np.diag([factor, factor, factor, 1.0]) @ matrix, options.depth_factor)


def _find_array(target: Target) -> LensArray:
    """Returns the lens array that a mesh is framed for."""
    return target.lens_array() if isinstance(target, IntegralDisplay) else _find_screen(target).lens_array()


def _find_screen(target: Quilt | Calibration) -> Screen:
    if isinstance(target, Quilt):
        return Screen(target.layout.aspect, target.cone)
    return Screen(target.aspect, target.cone, target.field_of_view)


def _render(scene: Scene, options: Options, target: Target, progress: Progress) -> DisplayPicture:
    """Renders the picture of a mesh placed at the display, with notes on its depth."""
    check = ObjectCheck(options.background, hides_backs=scene.hides_backs)
    caster = RayCaster(scene, options.background, check.count)
    samples = find_samples(options)
    layout: QuiltLayout | None = None
    pixels: Pixels
    if isinstance(target, IntegralDisplay):
        pixels = render_panel(caster, target, conversion=options.conversion, samples=samples, progress=progress)
        budget = measure_integral(scene, target)
    elif isinstance(target, Calibration):
        screen = _find_screen(target)
        pixels = screen.render_native(caster, target, progress=progress)
        budget = measure_lenticular(scene, screen, target)
    else:
        screen, layout = _find_screen(target), target.layout
        views = screen.render_views(caster, layout.count, target.tile, samples=samples, progress=progress)
        pixels = join_views(views, layout)
        budget = measure_quilt(scene, screen, layout.count, target.tile[1])
    ppi = None if isinstance(target, Quilt) else target.ppi
    notes = budget.notes(options.zoom, options.depth_factor, is_fitted=options.fit != "none")
    return DisplayPicture(pixels, (*notes, *caster.notes(), *check.list_notes()), layout, ppi)


def _describe(kind: Kind, target: Target) -> Report:
    """Returns the report's `display`."""
    numbers: dict[str, Any] = {
        key: None if value == math.inf else value
        for key, value in asdict(target).items()
        if key not in ("notes", "is_default")
    }
    if kind == "quilt":
        del numbers["layout"]["is_inverted"]  # written quilts never are
    return {"kind": kind, **numbers}
