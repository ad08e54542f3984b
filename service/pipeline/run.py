"""The main job: a mesh, an elemental image array or a set of views in, upscaled views out.

The command line and the HTTP routes call `reconstruct` and add nothing to it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import TYPE_CHECKING, Any

from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Scene
from ciir.renderer.views import parse_views
from ciir.service.pipeline import plan as plans
from ciir.service.pipeline.model_selection import Job
from ciir.service.pipeline.options import AUTO, NO_MODEL
from ciir.service.pipeline.plan import Plan
from ciir.service.pipeline.prefetch import ahead
from ciir.service.pipeline.report import Clock, Report, in_words, versions
from ciir.service.pipeline.schedule import at_once, turns
from ciir.service.pipeline.source import Input, Source
from ciir.service.pipeline.upscaling import describe_model, opened, skipped, unmatched
from ciir.service.pipeline.view_sources import MeshViews, PictureViews

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Sequence

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Writer
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.schedule import Turn
    from ciir.service.pipeline.upscaling import Enlarge

Progress = Callable[[int, int], object]
"""Called with the number of views that are finished and of all, first with 0 before any view is made."""


def reconstruct(
    source: Source,
    options: Options,
    writer: Writer,
    *,
    max_pixels: int | None = None,
    progress: Progress | None = None,
    clock: Clock | None = None,
) -> Report:
    """Gives the views that `options` ask for to `writer`, and returns the report, which `writer` gets too.

    Views are made, upscaled and encoded in turns, each stage in a thread of its own: their times overlap, so that they
    may add up to more than the total. `writer` and `progress` are called in the caller's thread. The first error in the
    order of views is raised, and no thread outlives the call.

    `max_pixels`: most output pixels of all views together; and samples of a mesh, where those views count too that are
    rendered only to help others. A mesh's views are RGB; pictures keep channels and depth. `clock`: what counts the
    stages' time.

    Raises the input faults of `ciir.errors` and `ciir.errors`, and `BackendUnavailable`; what the input's
    header and the options show is raised before `writer.begin`, so before anything is written.
    """
    clock = clock or Clock()
    given = Input(source)
    with clock.stage("decode"):
        content = given.read(options)
    with clock.stage("plan"):
        job = _job(given, content, options)
        plan = plans.make(options, job, mesh=content if isinstance(content, Scene) else None, limit=max_pixels)
        maker = _maker(content, options, plan, clock)
        rows, cols = maker.lenses
        plans.check_size(rows, cols, plan.enlarge, len(job.wanted), max_pixels)
        together = at_once(rows * cols * plan.enlarge**2)
        in_order = turns(job.wanted, job.grid, together=together, is_light_field=plan.is_light_field)
        made = [view for turn in in_order for view in turn.new]
        plans.check_work(maker.samples, len(made), max_pixels, plan.strategy, further=len(made) - len(job.wanted))
    statistics = SkipStatistics()
    enlarge = _load(plan, job.grid, statistics, clock, skip=options.skip == "exact")
    writer.begin(len(job.wanted), maker.sample)
    if progress is not None:
        progress(0, len(job.wanted))
    maker.start()

    written: list[dict[str, Any]] = []
    strange = 0.0
    pictures = ahead(_made(maker, in_order), name="views")
    with closing(ahead(_enlarged(pictures, enlarge, clock), name="upscale")) as finished:
        for wanted, large, left in finished:
            strange += left * len(wanted) / len(job.wanted)
            with clock.stage("encode"):
                for view, picture in zip(wanted, large, strict=True):
                    height, width = picture.shape[:2]
                    name = writer.write(view, picture)
                    written.append({"v": view[0], "u": view[1], "file": name, "height": height, "width": width})
            if progress is not None:
                progress(len(written), len(job.wanted))

    left_out = ({} if enlarge is None else skipped(statistics)) | maker.skipped() or None
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
            "reasons": [*plan.reasons, *maker.reasons, *in_words(left_out)],
            "skipped": left_out,
        },
        "model": describe_model(plan.model, plan.enlarge) if enlarge is not None else None,
        "options": options.as_dict(),
        "notes": [*maker.notes(), *_replaced(options, plan), *unmatched(strange)],
        "timings_ms": clock.timings_ms(),
        "versions": versions(*maker.packages, *(("onnxruntime",) if enlarge is not None else ())),
    }
    writer.finish(report)
    return report


def _made(maker: MeshViews | PictureViews, in_order: Sequence[Turn]) -> Generator[tuple[Turn, list[Pixels]]]:
    """Each turn with its new views."""
    pictures = maker.make([view for turn in in_order for view in turn.new])
    for turn in in_order:
        yield turn, maker.take(pictures, len(turn.new))


def _enlarged(
    made: Generator[tuple[Turn, list[Pixels]]], enlarge: Enlarge | None, clock: Clock
) -> Generator[tuple[Sequence[View], Iterable[Pixels], float]]:
    """Of each turn the wanted views, what is written of them, and the share of their pixels that another model made."""
    kept: dict[View, Pixels] = {}
    with closing(made):
        for turn, new in made:
            kept.update(zip(turn.new, new, strict=True))
            large: Iterable[Pixels] = [kept[view] for view in turn.wanted]
            left = 0.0
            if enlarge is not None:
                with clock.stage("upscale"):
                    large, left = enlarge(kept, turn.wanted)
            for view in turn.done:
                del kept[view]
            yield turn.wanted, large, left


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
            pixels = LightField.from_eia(pixels, rows=rows, cols=cols).eia(pickup="optical")
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


def _job(given: Input, content: Scene | LightField, options: Options) -> Job:
    if isinstance(content, Scene):
        array, is_transparent = plans.mesh_array(options), False
        grid = (array.pixels_v, array.pixels_u)
    else:
        grid, is_transparent = content.views.shape[:2], content.is_transparent()
    plans.check_views(options.views, grid, given.limits.views)
    return Job(given.name, isinstance(content, Scene), grid, is_transparent, parse_views(options.views, *grid))


def _replaced(options: Options, plan: Plan) -> list[str]:
    """A note where a light-field network was named and another model took its place."""
    is_other = plan.strategy == "upscale" and options.model not in (AUTO, plan.model)
    return [plan.reasons[-1]] if is_other else []


def _maker(content: Scene | LightField, options: Options, plan: Plan, clock: Clock) -> MeshViews | PictureViews:
    if isinstance(content, Scene):
        return MeshViews(content, options, plan, clock)
    return PictureViews(content, options, clock)


def _load(plan: Plan, grid: tuple[int, int], statistics: SkipStatistics, clock: Clock, *, skip: bool) -> Enlarge | None:
    if plan.model == NO_MODEL:
        return None
    with clock.stage("upscale"):  # the first call in a process reads the network
        return opened(plan, grid, skip=skip, statistics=statistics)
