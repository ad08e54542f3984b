"""Runs one task in a worker, with the pipeline of `ciir reconstruct`, unless its result already exists."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

from ciir.errors import Error
from ciir.renderer.readers.bundle import Bundle
from ciir.service.batch import parts
from ciir.service.batch.places import Outputs, open_place
from ciir.service.batch.record import Record
from ciir.service.batch.task import Outcome, Request, Task
from ciir.service.batch.trace import TracedFiles
from ciir.service.errors import join_lines
from ciir.service.outputs import write_file, write_folder
from ciir.service.pipeline.source import add_frames

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

open_outputs = lru_cache(8)(Outputs)


def work(task: Task, request: Request) -> Outcome:
    """Makes the output of `task`. An error in the input becomes an outcome; nothing else is caught."""
    begun = time.perf_counter()
    try:
        outcome = _work(task, request)
    except (Error, OSError) as error:
        outcome = Outcome("failed", error=join_lines(str(error)))
    return replace(outcome, seconds=round(time.perf_counter() - begun, 3))


def _work(task: Task, request: Request) -> Outcome:
    outputs = open_outputs(request.outputs)
    record = Record(outputs, task, request)
    if task.joined:
        return parts.join(task, request, outputs, record)
    source = add_frames(open_place(task.source), white=request.white, dark=request.dark)
    if record.is_current(source):
        return replace(record.outcome, status="done" if record.is_of(request.run) else "kept")
    files = TracedFiles(source.files if isinstance(source, Bundle) else {})
    if isinstance(source, Bundle):
        source = replace(source, files=files)
    if task.part is None and (cut := parts.cut(source, task, request.options)):
        return Outcome("cut", parts=cut)
    record.remove()
    with outputs.open_scratch() as scratch:
        path = scratch / task.out.rpartition("/")[2]
        report = _write(source, task, request, path)
        return record.write(outputs.move(path, task.out), files.trace, report)


def _write(source: Source, task: Task, request: Request, path: Path) -> Report:
    if task.part is None:
        return (write_file if task.is_file else write_folder)(source, request.options, path)
    if task.is_video:
        return parts.write_frames(source, task.part, request.options, path)
    return write_folder(source, parts.select_views(task.part, request.options), path)
