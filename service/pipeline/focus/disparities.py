"""Estimates the disparity of a view of any light field, and renders the disparity of a mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.focus.disparity import DisparityMap
from ciir.renderer.focus.stereo.search_range import SURE, find_texture
from ciir.renderer.focus.stereo.sweep import read_levels
from ciir.service.pipeline.focus.light_fields import capture, estimate_view
from ciir.service.pipeline.job import resolve_job
from ciir.service.pipeline.options import KINDS, NO_MODEL, Options
from ciir.service.pipeline.planning.plan import Plan
from ciir.service.pipeline.report import Clock, describe_array, find_versions
from ciir.service.pipeline.source import Input
from ciir.service.pipeline.stages.view_sources import MeshViews

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.job import Job
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source

OUTSIDE = 1
"""Per cent of an estimated map's confident pixels below the range, and above it: a few pixels are wrong by a lot."""


def find_disparity(
    source: Source,
    options: Options,
    *,
    max_pixels: int | None = None,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> tuple[DisparityMap, Report]:
    """Returns the disparity of the view that `options` ask for, in pixels of the map, and the report.

    The disparity of a mesh is exact: rendered, not estimated. Where the mesh is not seen, the disparity is that of its
    farthest point and the confidence is 0; elsewhere the confidence is 1. `progress` counts views, then the map. Raises
    the same errors as `service.pipeline.run.reconstruct`, and `InvalidOption`.
    """
    clock = clock or Clock()
    if Input(source).holds_mesh():
        return _render(source, options, clock)
    captured = capture(
        source, options, max_pixels=max_pixels, progress=lambda done, total: progress(done, total + 1), clock=clock
    )
    light_field, scale = captured.light_field, captured.scale
    with clock.stage("focus"):
        found = estimate_view(captured, options.view, options.limits)
    grid = light_field.shape[0] * light_field.shape[1]
    progress(grid + 1, grid + 1)
    notes = captured.report["notes"]
    notes += found.notes
    unused = [name for name in ("pitch", "delta", "parallax") if getattr(options, name) is not None]
    if unused:
        notes += [f"{', '.join(unused)}: a disparity map is in pixels and doesn't use it; a model (glb, ply) does"]
    if scale > 1:
        notes += [f"disparities are in pixels of the upscaled views, {scale} for each pixel read along each side"]
    return found, _complete(captured.report, found, _find_texture(found, light_field), options, clock, is_exact=False)


def _find_texture(found: DisparityMap, light_field: LightField) -> NDArray[np.bool_]:
    """Masks the pixels of the map's view, `(H, W)`, that have texture; elsewhere all disparities fit equally well."""
    view = light_field.view(*found.view)
    levels = read_levels(raise_levels(view, count_unused_bits(view)))
    return find_texture(levels, light_field.shape[:2])


def open_mesh(given: Input, options: Options, clock: Clock) -> tuple[Scene, Job, MeshViews]:
    """Reads a mesh and places it, ready to render depths. Raises `InputError` and `BackendUnavailable`."""
    with clock.stage("decode"):
        scene = given.read_mesh(options)
    job = resolve_job(given.name, scene, options, max_views=given.limits.views)
    views = MeshViews(scene, job, Plan("upscale", NO_MODEL, scale=1, samples=1), clock)
    views.open()
    return scene, job, views


def _render(source: Source, options: Options, clock: Clock) -> tuple[DisparityMap, Report]:
    """Renders the disparity of a mesh."""
    asked = {"limits": options.limits is not None, "model": options.model != NO_MODEL}
    if any(asked.values()):
        names = ", ".join(name for name, is_asked in asked.items() if is_asked)
        raise InvalidOption(f"{names}: the disparity of a mesh is rendered, not estimated; leave that out")
    if options.sampling != "pinhole":
        raise InvalidOption("sampling: the disparity of a mesh is that of each lens's centre; leave it out")
    given = Input(source)
    wanted = "center" if options.view is None else "{},{}".format(*options.view)
    scene, job, views = open_mesh(given, replace(options, views=wanted), clock)
    (view,) = job.wanted
    depth = views.render_depth(job.array, view)
    is_seen = np.isfinite(depth)
    if not is_seen.any():
        raise InvalidOption(f"view: nothing of {given.name} is seen from {view[0]},{view[1]}; give another view")
    disparity = (job.array.delta / job.array.pitch * np.where(is_seen, depth, depth[is_seen].max())).astype(np.float32)
    found = DisparityMap(view, disparity, is_seen.astype(np.float32), np.empty(0), "lenses")
    described = views.describe()
    report = {
        "input": given.describe(scene),
        "lens_array": describe_array(job),
        "scene_transform": described["transform"],
        "plan": {
            "strategy": "upscale",
            "backend": described["backend"],
            "sampling": "pinhole",
            "samples": 1,
            "model": NO_MODEL,
            "scale": 1,
            "reasons": described["reasons"],
            "skipped": None,
        },
        "model": None,
        "notes": [*scene.notes, *_list_unused(options)],
        "versions": find_versions(*described["packages"]),
    }
    return found, _complete(report, found, is_seen, options, clock, is_exact=True)


def _list_unused(options: Options) -> list[str]:
    """Returns a note on options on the looks of a mesh that are given and that its disparity doesn't depend on."""
    unused = [name for name in ("background", "light") if getattr(options, name) != getattr(Options, name)]
    names = " and ".join(unused)
    return [f"{names}: a disparity map doesn't depend on this; leave {names} out"] if unused else []


def _find_range(found: DisparityMap, counts: NDArray[np.bool_], *, is_exact: bool) -> Report | None:
    """Returns the range of disparities where `counts` is true and the confidence is high enough.

    It goes from percentile `OUTSIDE` to 100 - `OUTSIDE`, or from the least to the largest if the map is exact. The
    confidence is at least `SURE`, or the median confidence where `counts` is true if that is lower, as for noisy views.
    Returns None if `counts` is false everywhere.
    """
    if not counts.any():
        return None
    least = min(SURE, float(np.median(found.confidence[counts])))
    shown = found.hci[counts & (found.confidence >= least)]
    low, high = np.percentile(shown, [0, 100] if is_exact else [OUTSIDE, 100 - OUTSIDE])
    return {"least": float(low), "largest": float(high), "confidence": least}


def _complete(
    report: Report, found: DisparityMap, counts: NDArray[np.bool_], options: Options, clock: Clock, *, is_exact: bool
) -> Report:
    height, width = found.disparity.shape
    return report | {
        "disparity": {
            "view": list(found.view),
            "height": height,
            "width": width,
            "least": float(found.hci.min()),
            "largest": float(found.hci.max()),
            "confident": _find_range(found, counts, is_exact=is_exact),
            "exact": is_exact,
        },
        "options": options.as_dict(KINDS["disparity"].options),
        "timings_ms": clock.timings_ms(),
    }
