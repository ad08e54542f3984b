"""Runs the main job: a mesh, an elemental image array or a set of views in, upscaled views out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption, NothingVisible
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.framing import find_extremes, find_turn, make_frame, turn_back
from ciir.renderer.scene import Scene
from ciir.renderer.writers.writer import Contents
from ciir.service.pipeline.job import Job, check_kind, resolve_job
from ciir.service.pipeline.limits import check_frame_count, check_samples, check_size
from ciir.service.pipeline.options import NO_MODEL, RECONSTRUCTION
from ciir.service.pipeline.planning.plan import Plan, make_plan
from ciir.service.pipeline.report import Clock, Report, describe_array, find_versions, skip_reasons
from ciir.service.pipeline.source import Content, Input, Source
from ciir.service.pipeline.stages import moved_array
from ciir.service.pipeline.stages.arrangement import Arrangement
from ciir.service.pipeline.stages.batches import make_views, upscale_batches
from ciir.service.pipeline.stages.frames import FrameWriter, join_reports
from ciir.service.pipeline.stages.opening import open_session
from ciir.service.pipeline.stages.prefetch import prefetch
from ciir.service.pipeline.stages.schedule import Batch, batch_size, schedule_batches
from ciir.service.pipeline.stages.upscaling import (
    describe_model,
    describe_shares,
    describe_skipped,
    fallback_notes,
    finishing_reasons,
    load_upscaler,
)
from ciir.service.pipeline.stages.view_sources import LightFieldViews, open_source

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.models.light_field.finishing import Finishing
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Writer
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.stages.upscaling import UpscaleViews
    from ciir.service.pipeline.stages.view_sources import ViewSource

Progress = Callable[[int, int], object]
"""Called with the number of finished views and the number of all views; first with 0, before any view is made."""
MOST_KEPT = 256 * 2**20
"""Most bytes of a mesh at several times or yaws that are kept between framing and rendering."""


def reconstruct(
    source: Source,
    options: Options,
    writer: Writer,
    *,
    max_pixels: int | None = None,
    progress: Progress | None = None,
    clock: Clock | None = None,
) -> Report:
    """Passes the views that `options` ask for to `writer`. Returns the report, which `writer` also gets.

    Views are made, upscaled and encoded in batches, with each stage in its own thread, so the times of stages overlap
    and can add up to more than the total. `writer` and `progress` are called in the caller's thread. Errors are raised
    in the order of views, and no thread outlives the call. A mesh's views are RGB; pictures keep their channels and
    depth.

    `max_pixels`: most output pixels of all views together, and most samples of a mesh, including views that are
    rendered only to help others. `clock`: counts the time of the stages.

    Raises `InputError`, `ModelError` and `BackendUnavailable`. Errors that can be found from the input's header and the
    options are raised before `writer.begin`.
    """
    clock = clock or Clock()
    given = Input(source)
    if options.moments:
        return _reconstruct_frames(given, options, writer, max_pixels=max_pixels, progress=progress, clock=clock)
    with clock.stage("decode"):
        content = given.open(options, options.views, is_upscaled=options.model != NO_MODEL)
    report = _reconstruct(given, content, options, writer, max_pixels=max_pixels, progress=progress, clock=clock)
    writer.finish(report)
    return report


def _reconstruct_frames(
    given: Input,
    options: Options,
    writer: Writer,
    *,
    max_pixels: int | None,
    progress: Progress | None,
    clock: Clock,
) -> Report:
    """Passes one view of a mesh at each time or yaw to `writer`, all framed and made in the same way."""
    moments = options.moments
    each = [options.select_moment(moment) for moment in moments]
    with clock.stage("decode"):
        check_frame_count(len(moments), given.limits.views)
        content = _open_first(given, each)
        check_kind(given.name, content, options)
        assert isinstance(content, Scene)  # noqa: S101 - otherwise an option that makes frames was refused
    with clock.stage("plan"):
        job = resolve_job(given.name, content, each[0], max_views=given.limits.views, max_pixels=max_pixels)
        if len(job.wanted) > 1:
            (varied,) = moments[0]
            raise InvalidOption(
                f"{'rotate' if varied == 'yaw' else varied}: {len(moments)} {varied}s make a video of one view, and "
                f"{len(job.wanted)} views are asked for; give one of them with views, or one {varied}"
            )
        job = replace(job, frames=len(moments))
        plan = make_plan(job)
        check_size(job.lenses, plan.scale, count=len(moments), limit=max_pixels, remedy="fewer lenses")
    turns = [find_turn(content, job.placement, single.placement) for single in each]
    extremes, windows, size = [], [], 0
    kept: list[Scene | None] = []
    empty = set()  # the numbers of the times at which there is nothing to draw
    with clock.stage("decode"):
        for number, single in enumerate(each):
            try:
                scene = given.read_mesh(single)
            except NothingVisible:
                empty.add(number)
                kept.append(None)
                continue
            size += scene.nbytes
            kept.append(scene if size <= MOST_KEPT else None)  # otherwise it is read again later
            extremes.append(find_extremes(scene, job.array, single.placement, turns[number]))
            windows.append(scene.window)
        framed = make_frame(extremes, windows)
    reports = []
    frames = FrameWriter(writer, tuple(moment.get("time", 0.0) for moment in moments))
    for number, single in enumerate(each):
        if progress is not None:
            progress(number, len(moments))
        with clock.stage("decode"):
            scene = framed if number in empty else kept[number] or given.read_mesh(single)
            kept[number] = None
        content = replace(scene, framed=turn_back(framed, turns[number]))
        report = _reconstruct(
            given, content, single, frames, max_pixels=max_pixels, clock=clock, plan=plan, frames=len(moments)
        )
        reports.append(report | {"notes": []} if number in empty else report)
    if progress is not None:
        progress(len(moments), len(moments))
    shown = min({*range(len(each))} - empty)
    joined = join_reports(reports, moments)
    joined |= {"input": reports[shown]["input"], "options": options.as_dict(RECONSTRUCTION)}
    if empty:
        joined["notes"].append(
            f"time: nothing of the mesh is visible at {len(empty)} of {len(moments)} times, the first "
            f"{moments[min(empty)]['time']:g} s; only the background is drawn then"
        )
    writer.finish(joined)
    return joined


def _open_first(given: Input, each: Sequence[Options]) -> Content:
    """Opens the mesh at the first moment when there is something to draw; `each` are the options of the moments.

    At all yaws there is the same to draw. Raises the same errors as `Input.open`.
    """
    if all(single.time == each[0].time for single in each):
        return given.open(each[0], each[0].views)
    for single in each[:-1]:
        with suppress(NothingVisible):
            return given.open(single, single.views)
    return given.open(each[-1], each[-1].views)


def _reconstruct(
    given: Input,
    content: Content,
    options: Options,
    writer: Writer,
    *,
    max_pixels: int | None,
    clock: Clock,
    progress: Progress | None = None,
    plan: Plan | None = None,
    frames: int = 1,
) -> Report:
    """Passes the views of `content` to `writer`, and returns the report. Makes the plan if none is given."""
    with clock.stage("plan"):
        job = resolve_job(given.name, content, options, max_views=given.limits.views, max_pixels=max_pixels)
        job = replace(job, frames=frames)
        plan = plan or make_plan(job)
        views = open_source(job, plan, clock)
        given_as = {moved_array.find_place(view) if plan.moves_array else view: view for view in job.wanted}
        batches = _schedule(job, plan, views, list(given_as))
    statistics = SkipStatistics()
    upscale: UpscaleViews | None = None
    if plan.model != NO_MODEL:
        with clock.stage("upscale"):  # the first call in a process reads the network
            fetch = views.fetch_views if isinstance(views, LightFieldViews) else None
            upscale = load_upscaler(plan, _arrange(job, plan), fetch=fetch, skip=job.skip, statistics=statistics)
    writer.begin(_describe_contents(job, plan, views.sample))
    if progress is not None:
        progress(0, len(job.wanted))
    views.open()

    written: list[dict[str, Any]] = []
    finished: list[Finishing] = []
    made = prefetch(make_views(views, batches), name="views")
    opening = open_session(plan, views=len(job.wanted), pixels=job.lenses[0] * job.lenses[1])
    with closing(prefetch(upscale_batches(made, upscale, opening, clock), name="upscale")) as upscaled:
        for places, pictures, some in upscaled:
            wanted = [given_as[place] for place in places]
            finished += some
            with clock.stage("encode"):
                shares = describe_shares(plan, some) or [{}] * len(wanted)
                for view, picture, share in zip(wanted, pictures, shares, strict=True):
                    height, width = picture.shape[:2]
                    name = writer.write(view, picture)
                    written.append({"v": view[0], "u": view[1], "file": name, "height": height, "width": width} | share)
            if progress is not None:
                progress(len(written), len(job.wanted))

    described = views.describe()
    is_sampled = plan.restores_means or (job.mesh is not None and plan.strategy == "upscale")
    skipped = ({} if upscale is None else describe_skipped(statistics)) | described["skipped"] or None
    return {
        "input": given.describe(content),
        "lens_array": describe_array(job),
        "scene_transform": described["transform"],
        "views": written,
        "plan": {
            "strategy": plan.strategy,
            "backend": described["backend"],
            "sampling": job.sampling if is_sampled else None,
            "samples": plan.samples,
            "model": plan.model,
            "scale": plan.scale,
            "reasons": [
                *plan.reasons,
                *described["reasons"],
                *finishing_reasons(plan, finished),
                *skip_reasons(skipped),
            ],
            "skipped": skipped,
        },
        "model": describe_model(plan.model, plan.scale) if upscale is not None else None,
        "options": options.as_dict(RECONSTRUCTION),
        "notes": [*described["notes"], *plan.notes, *fallback_notes(finished, of_mesh=job.mesh is not None)],
        "timings_ms": clock.timings_ms(),
        "versions": find_versions(*described["packages"], *(("onnxruntime",) if upscale is not None else ())),
    }


def _schedule(job: Job, plan: Plan, views: ViewSource, wanted: Sequence[View]) -> list[Batch]:
    """Schedules the batches of the job, including its neighbouring views.

    Raises `TooLarge` if they exceed its limits.
    """
    frames = len(job.wanted) * job.frames
    remedy = "a smaller input" if job.mesh is None else "fewer lenses"
    check_size(job.lenses, plan.scale, count=frames, limit=job.max_pixels, remedy=remedy)
    size = batch_size(job.lenses[0] * job.lenses[1] * plan.scale**2)
    batches = schedule_batches(wanted, _arrange(job, plan), size=size, is_light_field=plan.is_light_field)
    count = sum(len(batch.new) for batch in batches)
    neighbours = count - len(job.wanted)
    check_samples(
        views.samples,
        count * job.frames,
        job.max_pixels,
        plan.strategy,
        samples=job.samples,
        neighbours=neighbours * job.frames,
    )
    return batches


def _arrange(job: Job, plan: Plan) -> Arrangement:
    """Returns which views are neighbours. The pictures are examined for this only if the model takes several views."""
    if plan.moves_array:
        return Arrangement(moved_array.list_grid(job.grid))
    return job.arrangement if plan.is_light_field else Arrangement(job.grid)


def _describe_contents(job: Job, plan: Plan, sample: Pixels) -> Contents:
    """Returns what a writer needs to know: views like `sample`, `(1, 1, C)`."""
    rows, cols = job.lenses
    return Contents(
        views=job.wanted,
        grid=job.grid,
        height=rows * plan.scale,
        width=cols * plan.scale,
        channels=sample.shape[2],
        dtype=sample.dtype,
        depth_sense=job.depth_sense,
        scale=plan.scale,
        pixel_aspect=job.pixel_aspect,
        is_mesh=job.mesh is not None,
    )
