"""The light field for planes and disparity maps: any input, with all its views, upscaled if asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.focus.apertures import read_aperture
from ciir.renderer.focus.depth_scale import DepthScale
from ciir.renderer.focus.disparity import estimate_disparity
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Scene
from ciir.service.pipeline.collection import collect_views
from ciir.service.pipeline.options import NO_MODEL
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from ciir.renderer.focus.disparity import DisparityMap
    from ciir.renderer.light_field import LightField
    from ciir.renderer.views import View
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Clock, Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source


@dataclass(frozen=True, eq=False)
class Captured:
    """All views of an input."""

    light_field: LightField
    scale: int
    """Pixels for each pixel of the views that were read, along each side."""
    sign: int
    """The sign of the light field's disparities if larger is to be nearer: -1 with the depth sense `lenses`."""
    depths: DepthScale | None
    """Depth against disparity, with larger disparities nearer, in pixels of the views that were read; None if nothing
    is known about it."""
    report: Report
    """The report on the views, without their list."""
    count: int
    """Number of views that were made."""


def estimate_view(captured: Captured, view: View | None, limits: tuple[float, float] | None) -> DisparityMap:
    """Estimates the disparity of a view, by default the centre one.

    `limits`: larger is nearer, in pixels of the views that were read. Raises `InvalidOption`.
    """
    if limits is not None:
        low, high = sorted(captured.sign * captured.scale * limit for limit in limits)
        limits = low, high
    if view is not None:
        captured.light_field.view(*view)
    return estimate_disparity(captured.light_field, view, limits=limits)


def capture(
    source: Source,
    options: Options,
    *,
    max_pixels: int | None,
    progress: Progress,
    clock: Clock,
) -> Captured:
    """Reads or renders all views of `source`, and upscales those from `_select_views` with the model of `options`.

    The other views are then black. Raises the same errors as `service.pipeline.run.reconstruct`, and `InvalidOption`
    for a single view and for camera options that are incomplete or don't fit.
    """
    with clock.stage("decode"):
        options = replace(options, views=_select_views(source, options))
    light_field, report = collect_views(source, options, max_pixels=max_pixels, progress=progress, clock=clock)
    count = len(report.pop("views"))
    if light_field.shape[0] * light_field.shape[1] == 1:
        raise InvalidOption(
            f"{report['input']['name']}: one view shows no depth; give an elemental image array with lenses or pixels, "
            "or two views or more"
        )
    depths = find_depths(options, report)
    sign = 1 if light_field.depth_sense == "cameras" else -1
    return Captured(light_field, report["plan"]["scale"], sign, depths, report, count)


def _select_views(source: Source, options: Options) -> str:
    """Selects the views to make: all, or, if views are upscaled, those that the aperture of planes lets through.

    All views are made for a mesh, because its model may depend on how many are rendered; with alpha, because the method
    then depends on all views; and to find disparities. Raises `InputError`.
    """
    given = Input(source)
    if options.aperture is None or options.model == NO_MODEL or options.all_in_focus == "yes" or given.holds_mesh():
        return "all"
    content = given.open(options, "all")
    if isinstance(content, Scene) or content.shape[4] in (2, 4):
        return "all"
    weights = read_aperture(options.aperture, content.shape[:2], options.aperture_shape)
    return ";".join(f"{v},{u}" for v, u in np.argwhere(weights))


def find_depths(options: Options, report: Report, scale: int = 1) -> DepthScale | None:
    """Finds how depth relates to disparity, in pixels of views that were upscaled by `scale`; None if nothing is known.

    Raises `InvalidOption`.
    """
    array = report["lens_array"]
    if options.camera_pitch is None or options.focal_length is None or options.sensor is None:
        if array["pitch"] is None or array["delta"] is None:
            return None
        lenses = LensArray(*(array[name] for name in ("rows", "cols", "pixels_v", "pixels_u", "pitch", "delta")))
        return DepthScale.from_lenses(lenses, sense="cameras")
    if array["pitch"] is not None or array["delta"] is not None:
        raise InvalidOption("camera_pitch: this is for camera arrays and the input has a lens array; leave one out")
    zero = math.inf if options.convergence is None else options.convergence
    columns = scale * array["cols"]
    return DepthScale.from_cameras(options.camera_pitch, options.focal_length, options.sensor, columns, zero=zero)
