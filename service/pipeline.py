"""The main job: a mesh, an elemental image array or a set of views in, upscaled views out.

The command line and the HTTP routes call `reconstruct` and add nothing to it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

from renderer.light_field import LightField
from renderer.scene import Scene
from renderer.views import parse_views
from service import plan as plans
from service.makers import MeshViews, PictureViews
from service.plan import NO_MODEL, Plan
from service.report import Clock, Report, versions
from service.source import Input, Source

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.upscaler import Upscaler
    from renderer.pictures import Pixels
    from service.outputs import Sink
    from service.request import Options

Progress = Callable[[int], object]
"""Called with the number of views that were finished since its last call."""

BATCH_PIXELS = 4_000_000
"""Output pixels that are worked on at once, in whole views: what bounds memory."""


def reconstruct(
    source: Source,
    options: Options,
    sink: Sink,
    *,
    max_pixels: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Puts the views that `options` ask for into `sink`, and returns the report that `sink` got too.

    `max_pixels`: most output pixels, and samples of a mesh, of all views together. A mesh's views are RGB; pictures
    keep channels and depth.

    Raises the input faults of `renderer.errors` and `models.errors`, and `BackendUnavailable`; what the input's
    header and the options show is raised before `sink.begin`, so before anything is written.
    """
    clock = Clock()
    given = Input(source)
    with clock.stage("decode"):
        content = given.read(options)
    plan = plans.make(options, name=given.name, is_mesh=isinstance(content, Scene))
    maker = _maker(content, options, plan, clock)
    plans.check_views(options.views, maker.pixels)
    views = parse_views(options.views, *maker.pixels)
    rows, cols = maker.lenses
    plans.check_size(rows, cols, plan.enlarge, len(views), max_pixels)
    plans.check_work(maker.samples, len(views), max_pixels)
    upscaler = _load(plan, clock)
    sink.begin(len(views))
    maker.start()

    written: list[dict[str, Any]] = []
    together = max(1, BATCH_PIXELS // (rows * cols * plan.enlarge**2))
    in_turn = maker.make(views)
    for first in range(0, len(views), together):
        part = views[first : first + together]
        pictures = maker.batch(in_turn, len(part))
        if upscaler is not None:
            with clock.stage("upscale"):
                pictures = enlarge(upscaler, pictures)
        with clock.stage("encode"):
            for view, picture in zip(part, pictures, strict=True):
                height, width = picture.shape[:2]
                name = sink.add(view, picture)
                written.append({"v": view[0], "u": view[1], "file": name, "height": height, "width": width})
        if progress is not None:
            progress(len(part))

    is_upscaled_mesh = isinstance(content, Scene) and plan.strategy == "upscale"
    report: Report = {
        "input": given.described(content),
        "lens_array": maker.lens_array(),
        "scene_transform": maker.transform,
        "views": written,
        "plan": {
            "strategy": plan.strategy,
            "backend": maker.backend,
            "sampling": options.sampling if is_upscaled_mesh else None,
            "samples": plan.samples,
            "model": plan.model,
            "scale": plan.enlarge,
            "reasons": [*plan.reasons, *maker.reasons],
        },
        "model": describe_model(plan.model, plan.enlarge) if upscaler is not None else None,
        "options": options.as_dict(),
        "notes": maker.notes(),
        "timings_ms": clock.timings_ms(),
        "versions": versions(*maker.packages, *(("onnxruntime",) if upscaler is not None else ())),
    }
    sink.finish(report)
    return report


def elemental(source: Source, options: Options, keep: Callable[[Pixels], object]) -> Report:
    """Gives a mesh's elemental image array, `(rows*pixels_v, cols*pixels_u, 3)` RGB, to `keep`; returns its report.

    The time that `keep` takes is counted as `encode`. Of `options`, those that speak of a model or of single views
    don't apply. Raises as `reconstruct`, and `InvalidOption` where the input is no mesh.
    """
    clock = Clock()
    given = Input(source)
    plans.check_eia(options)
    with clock.stage("decode"):
        scene = given.read_mesh(options)
    plan = Plan("upscale", NO_MODEL, 1, plans.samples(options), ())
    maker = MeshViews(scene, options, plan, clock)
    maker.start()
    pixels: Pixels = maker.elemental()
    if options.pickup == "optical":
        with clock.stage("map"):
            rows, cols = maker.lenses
            pixels = LightField.from_eia(pixels, rows=rows, cols=cols).to_eia(pickup="optical")
    with clock.stage("encode"):
        keep(pixels)
    return {
        "input": given.described(scene),
        "lens_array": maker.lens_array(),
        "scene_transform": maker.transform,
        "plan": {
            "backend": maker.backend,
            "sampling": options.sampling,
            "samples": plan.samples,
            "pickup": options.pickup,
            "reasons": maker.reasons,
        },
        "notes": maker.notes(),
        "timings_ms": clock.timings_ms(),
        "versions": versions(*maker.packages),
    }


def describe_model(name: str, scale: int) -> dict[str, Any]:
    """The report's `model`: name, scale, and the network's SHA-256 (null for interpolation)."""
    from models import catalogue

    card = next(entry.card for entry in catalogue.entries() if entry.name == name)
    return {"name": name, "scale": scale, "sha256": card.sha256 if card is not None else None}


def enlarge(upscaler: Upscaler, pictures: Pixels) -> Pixels:
    """`models.upscale_pixels`: `(N, H, W, C)` to `(N, scale*H, scale*W, C)` of the same type."""
    from models.pixels import upscale_pixels

    # Its type variable takes 8 or 16 bit, where a picture that was read is either: one of them stands for both.
    return upscale_pixels(upscaler, cast("NDArray[np.uint8]", pictures))


def _maker(content: Scene | LightField, options: Options, plan: Plan, clock: Clock) -> MeshViews | PictureViews:
    if isinstance(content, Scene):
        return MeshViews(content, options, plan, clock)
    return PictureViews(content, options, clock)


def _load(plan: Plan, clock: Clock) -> Upscaler | None:
    if plan.model == NO_MODEL:
        return None
    with clock.stage("upscale"):  # the first call in a process reads the network
        from models import catalogue

        return catalogue.load(plan.model, scale=plan.enlarge)
