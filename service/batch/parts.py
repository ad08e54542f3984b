"""Large light fields and videos: cuts them into parts, which workers make in parallel, and joins the parts.

A part is a folder of PNGs with a report. A light field is cut into runs of its views, and each part reads the views in
their windows; a video of elemental image arrays is cut into runs of its frames.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers import video
from ciir.renderer.readers.inputs import find_main
from ciir.renderer.readers.pictures import decode
from ciir.renderer.scene import Scene
from ciir.renderer.views import parse_views
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.containers.video import PathWriter
from ciir.renderer.writers.file_writer import make_writer
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import BY_SUFFIX, BY_SUFFIX_OF_TIMES, check_options
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import REPORT, Contents, report_json
from ciir.service.batch.places import PARTS, STATE
from ciir.service.batch.record import Record, hash_name
from ciir.service.batch.task import Outcome, Part, Task
from ciir.service.pipeline import run
from ciir.service.pipeline.job import resolve_job
from ciir.service.pipeline.planning.plan import make_plan
from ciir.service.pipeline.source import Input
from ciir.service.pipeline.stages.frames import FrameWriter, join_reports

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.batch.places import Outputs
    from ciir.service.batch.task import Request
    from ciir.service.batch.trace import Trace
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

PART_PIXELS = 1 << 25
"""Output pixels of a part, which take a core from some seconds to half a minute."""
MOST_FRAMES = 64
"""Most frames in a part of a video."""


def cut(source: Source, task: Task, options: Options) -> tuple[Part, ...]:
    """Returns the parts in which the task is done; empty if it is done as a whole. Raises `InputError`."""
    if task.is_video:
        return _cut_video(source, options)
    is_single = options.views == "center" or ("," in options.views and ";" not in options.views)
    if is_single or options.moments:
        return ()
    given = Input(source)
    content = given.open(options, options.views)
    if isinstance(content, Scene):  # neighbouring views are rendered to help, and parts would render them again
        return ()
    job = resolve_job(given.name, content, options, max_views=given.limits.views)
    each = job.lenses[0] * job.lenses[1] * options.scale**2
    size = max(1, PART_PIXELS // each)
    if len(job.wanted) <= size:
        return ()
    model = make_plan(job).model
    starts = range(0, len(job.wanted), size)
    return tuple(Part(f"views_{start:06d}", views=job.wanted[start : start + size], model=model) for start in starts)


def select_views(part: Part, options: Options) -> Options:
    """Returns the options for a part of a light field, with the model that was selected for all of it."""
    return replace(options, views=";".join(f"{v},{u}" for v, u in part.views), model=part.model)


def _cut_video(source: Source, options: Options) -> tuple[Part, ...]:
    data, bundle = _open_video(source)
    (height, width), times = video.list_times(data, bundle.name, bundle.limits)
    pixels_v, pixels_u = options.pixels or (1, 1)
    rows, columns = options.lenses or (max(1, height // pixels_v), max(1, width // pixels_u))
    wanted = parse_views(options.views, height // rows, width // columns)
    if len(wanted) > 1:
        raise InvalidOption(
            f"views: the frames of {bundle.name} make a video of one view, and {len(wanted)} are asked for; give one "
            "of them, or one frame"
        )
    size = min(MOST_FRAMES, max(1, PART_PIXELS // (rows * columns * options.scale**2)))
    starts = range(0, len(times), size)
    return tuple(Part(f"frames_{start:06d}", first=start, times=tuple(times[start : start + size])) for start in starts)


def _open_video(source: Source) -> tuple[bytes, Bundle]:
    assert isinstance(source, Bundle)  # noqa: S101 - it has the suffix of a video
    found = find_main(source)
    assert found is not None  # noqa: S101
    return source.files[found[1]], source


def write_frames(source: Source, part: Part, options: Options, path: Path) -> Report:
    """Writes the view of each frame of the part to a folder. The report is that of the first frame, with all views."""
    data, bundle = _open_video(source)
    reports = []
    with FolderWriter(path) as writer:
        frames = FrameWriter(writer, part.times)
        pictures = video.read_frames(data, bundle.name, bundle.limits, first=part.first, count=len(part.times))
        for number, pixels in enumerate(pictures, part.first):
            name = f"{bundle.name} frame {number}.png"
            frame = Bundle(name, name, {name: encode_png(pixels)}, bundle.limits)
            reports.append(run.reconstruct(frame, options, frames))
        report = join_reports(reports, [{"time": time} for time in part.times])
        writer.finish(report)
    return report


def list_part_tasks(task: Task, parts: Sequence[Part]) -> list[Task]:
    """Lists the tasks that make the parts."""
    folder = f"{STATE}/{PARTS}/{hash_name(task.out)}"
    return [replace(task, out=f"{folder}/{part.name}", is_file=False, part=part, whole=task.out) for part in parts]


def _read_report(outputs: Outputs, name: str, record: Record) -> Report:
    try:
        report: Report = json.loads(outputs.read(name) or b"")
    except ValueError as error:
        record.remove()  # so that the part is made again
        raise Unreadable(f"{name}: missing or damaged; run the batch again to make that part again") from error
    return report


def join(task: Task, request: Request, outputs: Outputs, record: Record) -> Outcome:
    """Makes the output from its finished parts, and removes them."""
    tasks = list_part_tasks(task, task.joined)
    records = [Record(outputs, each, request) for each in tasks]
    record.remove()
    with outputs.open_scratch() as scratch:
        reports = [_read_report(outputs, f"{each.out}/{REPORT}", of) for each, of in zip(tasks, records, strict=True)]
        trace = _join_traces([each.trace for each in records])
        report = _join_reports(reports, request.options)
        if "bytes" in report["input"] and not task.is_video:  # for a video, this is the first frame
            report["input"] |= {"bytes": sum(trace["sizes"].values()), "files": len(trace["sizes"])}
        pictures = [
            outputs.fetch(f"{each.out}/{view['file']}", scratch / f"{number}_{view['file']}")
            for number, (each, part) in enumerate(zip(tasks, reports, strict=True))
            for view in part["views"]
        ]
        path = scratch / task.out.rpartition("/")[2]
        times = tuple(time for part in task.joined for time in part.times)
        if times:
            report["views"] = [view | {"file": f"frame_{n:04d}.png"} for n, view in enumerate(report["views"])]
        if task.is_file:
            _write_file(path, report, pictures, times, request.options)
        else:
            check_options(request.options, (), "a folder of views")
            path.mkdir()
            for view, picture in zip(report["views"], pictures, strict=True):
                _link(picture, path / view["file"])
            (path / REPORT).write_bytes(report_json(report))
        outcome = record.write(outputs.move(path, task.out), trace, report)
    for each in records:
        each.remove()
    outputs.remove_folder(f"{STATE}/{PARTS}/{hash_name(task.out)}")
    return outcome


def _write_file(
    path: Path, report: Report, pictures: Sequence[Path], times: tuple[float, ...], options: Options
) -> None:
    """Writes the pictures in the format of the suffix. For a video of frames, none of them stay in memory."""
    suffix = path.suffix.lower()
    format_ = (BY_SUFFIX_OF_TIMES if times else BY_SUFFIX)[suffix]
    contents = _describe(report, _read(pictures[0]), times)
    with replacing(path) as file, make_writer(format_, file, options.make_writer_options(suffix)) as writer:
        if isinstance(writer, PathWriter) and times:
            report["notes"] += writer.stream(contents, map(_read, pictures))
            return
        writer.begin(contents)
        for view, entry, pixels in zip(contents.views, report["views"], map(_read, pictures), strict=True):
            entry["file"] = writer.write(view, pixels)
        writer.finish(report)


def _describe(report: Report, sample: Pixels, times: tuple[float, ...]) -> Contents:
    array = report["lens_array"]
    height, width, channels = sample.shape
    views = tuple((0, number) for number in range(len(times))) or tuple((e["v"], e["u"]) for e in report["views"])
    grid = (1, len(times)) if times else (array["pixels_v"], array["pixels_u"])
    scale = report["plan"]["scale"]
    return Contents(views, grid, height, width, channels, sample.dtype, array["depth_sense"], times, scale)


def _read(path: Path) -> Pixels:
    return decode(path.read_bytes(), name=path.name)


def _link(source: Path, target: Path) -> None:
    """Makes a hard link to a file, or a copy if the file system has no hard links."""
    try:
        target.hardlink_to(source)
    except OSError:
        shutil.copyfile(source, target)


def _join_reports(reports: Sequence[Report], options: Options) -> Report:
    """Joins reports: the first part's report, with the views, the reasons, the notes and the timings of all."""
    first = reports[0]
    timings: dict[str, float] = {}
    for report in reports:
        for stage, ms in report["timings_ms"].items():
            timings[stage] = round(timings.get(stage, 0.0) + ms, 3)
    plan: dict[str, Any] = first["plan"]
    every = dict.fromkeys(reason for report in reports for reason in report["plan"]["reasons"])
    reasons = [reason for reason in every if not reason.startswith("skipped: ")]
    made = f"made in {len(reports)} parts, whose times are added up" if len(reports) > 1 else ""
    joined = {"reasons": [*reasons, *([made] if made else [])], "skipped": None}
    return {
        **first,
        "views": [view for report in reports for view in report["views"]],
        "plan": plan | joined,
        "options": first["options"] | {"views": options.views, "model": options.model},
        "notes": list(dict.fromkeys(note for report in reports for note in report["notes"])),
        "timings_ms": timings,
    }


def _join_traces(traces: Sequence[Trace]) -> Trace:
    joined: Trace = {"files": {}, "sizes": {}, "looked_for": {}, "names": None}
    for trace in traces:
        joined["files"] |= trace["files"]
        joined["sizes"] |= trace["sizes"]
        joined["looked_for"] |= trace["looked_for"]
        joined["names"] = trace["names"] or joined["names"]
    return joined
