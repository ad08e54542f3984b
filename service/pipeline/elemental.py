"""Renders a mesh's elemental image array: the job of `ciir elemental`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.layout import TEXT, write_text
from ciir.renderer.writers.pictures import encode
from ciir.service.pipeline.job import resolve_array, resolve_job
from ciir.service.pipeline.limits import check_eia, check_samples
from ciir.service.pipeline.options import NO_MODEL
from ciir.service.pipeline.planning.plan import Plan
from ciir.service.pipeline.report import Clock, Report, describe_array, find_versions
from ciir.service.pipeline.source import Input, Source
from ciir.service.pipeline.stages.view_sources import MeshViews

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.pipeline.options import Options


def render_eia(
    source: Source,
    options: Options,
    keep: Callable[[Pixels], object],
    *,
    max_pixels: int | None = None,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> Report:
    """Passes a mesh's EIA, `(rows*pixels_v, cols*pixels_u, 3)` RGB, to `keep`, and returns its report.

    `max_pixels`: most samples of the mesh. `progress` counts views, or lenses if these are fewer. Raises the same
    errors as `reconstruct`, and `InvalidOption` if the input is not a mesh.
    """
    clock = clock or Clock()
    given = Input(source)
    array = resolve_array(options)
    check_eia(array)
    with clock.stage("decode"):
        scene = given.read_mesh(options)
    job = resolve_job(given.name, scene, replace(options, pickup=None), max_views=given.limits.views)
    points = array.rows * array.cols * job.samples**2
    check_samples(points, array.pixels_v * array.pixels_u, max_pixels, "upscale", samples=job.samples)
    views = MeshViews(scene, job, Plan("upscale", NO_MODEL, 1, job.samples), clock)
    views.open()
    pixels: Pixels = views.render_eia(progress)
    if options.pickup == "optical":
        with clock.stage("map"):
            rows, cols = job.lenses
            pixels = LightField.from_eia(pixels, rows=rows, cols=cols).eia(pickup="optical")
    with clock.stage("encode"):
        keep(pixels)
    described = views.describe()
    return {
        "input": given.describe(scene),
        "lens_array": describe_array(job),
        "scene_transform": described["transform"],
        "plan": {
            "backend": described["backend"],
            "sampling": job.sampling,
            "samples": job.samples,
            "pickup": options.pickup or "virtual",
            "reasons": described["reasons"],
        },
        "notes": described["notes"],
        "timings_ms": clock.timings_ms(),
        "versions": find_versions(*described["packages"]),
    }


def encode_eia(pixels: Pixels, options: Options, suffix: str = ".png") -> bytes:
    """Encodes the output of `render_eia` with `options` as a picture file.

    A PNG states the layout of its lenses, so that it can be read without options.
    """
    array = resolve_array(options)
    shape = (array.pixels_v, array.pixels_u, array.rows, array.cols)
    return encode(pixels, suffix, {TEXT: write_text("eia", shape, options.pickup or "virtual")})
