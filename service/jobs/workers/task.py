"""One piece of work: an input file and what is asked of it, to a result file. It runs in a worker process.

Whoever asks for the work imports this module, too: what the work itself needs is imported where it is done.
"""

from __future__ import annotations

import errno
import json
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ciir.errors import Error
from ciir.service.errors import find_response, join_lines
from ciir.service.jobs.job import Problem, Request, Result
from ciir.service.pipeline.report import Clock

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ciir.renderer.limits import Limits
    from ciir.service.settings import Settings

Outcome = Result | Problem
PROGRESS_SECONDS = 0.25
"""Views that are done are told so often at most."""
_OVER = "Over a limit"
_WARM_GRID, _WARM_SIDE = (3, 3), 32
"""What models are first run on: the least of a light field."""
_WARM_MESH = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@dataclass(frozen=True)
class TaskLimits:
    """What an input may hold, and its work may use."""

    limits: Limits
    output_pixels: int
    """Of all views together; samples of a mesh, too."""
    memory: int
    """Bytes; what `service.jobs.workers.sandbox` holds the process to, for the messages alone."""
    file: int
    """Bytes of the result; likewise."""
    cpu_seconds: int
    """Processor time."""

    @classmethod
    def from_settings(cls, settings: Settings) -> TaskLimits:
        """As the settings say."""
        return cls(
            settings.limits,
            settings.max_output_pixels,
            settings.worker_memory_bytes,
            settings.worker_file_bytes,
            settings.worker_cpu_seconds,
        )


@dataclass(frozen=True)
class Task:
    """What is to be done."""

    id: str
    """The job's."""
    request: Request
    source: Path
    """The input."""
    target: Path
    """Where the result is written, in a folder of its own: temporary files are put beside it. Unless the outcome is a
    `Result`, there may be a part of one, or nothing."""

    @property
    def told(self) -> Path:
        """Where the work tells how far it is: an object of JSON on each line, as the data of a `progress` event."""
        return self.target.with_name(f"{self.target.name}.progress")

    @property
    def report(self) -> Path:
        """The result's report without its list of views, as JSON."""
        return self.target.with_name(f"{self.target.name}.report")


@dataclass(frozen=True)
class Done:
    """What came of the work."""

    outcome: Outcome
    is_spent: bool = False
    """Memory ran out: this process may have been left with less than it needs, and is to be replaced."""


def run_task(work: Task, allowed: TaskLimits) -> Done:
    """Reconstructs. Whatever is wrong with the input is a `Problem`, as are a limit on memory or file size, and a full
    disk; anything else that is raised is a fault of this program. A result's report is in `work.report` instead.
    """
    from ciir.service.jobs.workers import sandbox

    sandbox.allow_cpu(allowed.cpu_seconds)
    tempfile.tempdir = str(work.target.parent)
    try:
        return Done(reconstruct(work, allowed))
    except Error as error:
        response = find_response(error)
        return Done(Problem(response.status, response.title, join_lines(str(error))), _is_memory(error))
    except Exception as error:
        problem = _of_this_machine(error, allowed)
        if problem is None:
            raise
        return Done(problem, _is_memory(error))


def _of_this_machine(error: Exception, allowed: TaskLimits) -> Problem | None:
    """What `error` says of room on the disk or in memory; None where it speaks of something else."""
    why = getattr(error, "errno", None)
    if why == errno.EFBIG:
        detail = f"the result is over {allowed.file:,} bytes; ask for fewer views or a smaller scale"
        return Problem(413, _OVER, detail)
    if why in (errno.ENOSPC, errno.EDQUOT):
        return Problem(503, "No room", "the server's disk is full; ask again when whoever runs it has made room")
    if _is_memory(error):
        detail = (
            f"this takes more than {allowed.memory:,} bytes of memory; give a smaller input, or ask for fewer views"
        )
        return Problem(413, _OVER, detail)
    return None


def _is_memory(error: BaseException) -> bool:
    """Whether `error`, or what it came of, is that memory ran out. Libraries in C++ say so in words alone."""
    words = str(error).lower()
    return (
        isinstance(error, MemoryError)
        or getattr(error, "errno", None) == errno.ENOMEM
        or any(said in words for said in ("bad_alloc", "bad allocation", "allocate memory"))
        or (error.__cause__ is not None and _is_memory(error.__cause__))
    )


def reconstruct(work: Task, allowed: TaskLimits) -> Result:
    """Writes the result and its report; raises whatever the pipeline does."""
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.writers.formats import FileWriter
    from ciir.service.pipeline import run as pipeline
    from ciir.service.pipeline.options import Options

    options = Options.parse(work.request.options)
    bundle = Bundle.from_upload(work.request.name, work.source.read_bytes(), allowed.limits)
    teller = Teller(work.told)
    with work.target.open("w+b") as file, FileWriter(file, work.request.format) as writer:
        report = pipeline.reconstruct(
            bundle, options, writer, max_pixels=allowed.output_pixels, progress=teller.done, clock=teller
        )
    kept = {name: told for name, told in report.items() if name != "views"}  # up to 65,536, which each poll would parse
    work.report.write_bytes(json.dumps(kept, allow_nan=False).encode())
    return Result(writer.format.name, work.target.stat().st_size, {})


class Teller(Clock):
    """A clock of stages that tells of each, once, when it begins, and of views as they are done."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._lock, self._begun_stages = path, threading.Lock(), set[str]()
        self._stage, self._views_done, self._views, self._told = "decode", 0, 0, float("-inf")

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """As `Clock.stage`."""
        with self._lock:
            if name not in self._begun_stages:
                self._begun_stages.add(name)
                self._stage = name
                self._tell()
        with super().stage(name):
            yield

    def done(self, views_done: int, views: int) -> None:
        """`views_done` of `views` are finished."""
        with self._lock:
            self._views_done, self._views = views_done, views
            if views_done in (0, views) or time.monotonic() - self._told >= PROGRESS_SECONDS:
                self._tell()

    def _tell(self) -> None:
        self._told = time.monotonic()
        data = {"stage": self._stage, "views_done": self._views_done, "views": self._views}
        with self._path.open("ab", buffering=0) as file:
            file.write(json.dumps(data).encode() + b"\n")


def warm_up() -> list[str]:
    """Loads what most work needs, and runs each model that `auto` may take, for one view and for many: a second or two.

    Returns what this process is not kept from, in words.
    """
    import io

    import numpy as np

    from ciir.models import catalogue
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.views import parse_views
    from ciir.renderer.writers.formats import FileWriter
    from ciir.service.jobs.workers import sandbox
    from ciir.service.pipeline import run as pipeline
    from ciir.service.pipeline import upscaling
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.plan import Plan

    view = np.zeros((_WARM_SIDE, _WARM_SIDE, 3), np.uint8)
    for model, is_light_field in ((catalogue.default_name(), False), (catalogue.light_field_default_name(), True)):
        if model in catalogue.list_names():
            run = upscaling.opened(Plan("upscale", model, 2, 1, (), is_light_field), _WARM_GRID, skip=False)
            every = parse_views("all", *_WARM_GRID)
            for wanted in ([(1, 1)], every):  # one by all cores, many with one each: sessions of their own
                run(dict.fromkeys(every, view), wanted)
    mesh = Bundle.from_upload("mesh.off", _WARM_MESH)
    with FileWriter(io.BytesIO(), "png") as writer:
        pipeline.reconstruct(mesh, Options(lenses=(8, 8), pixels=(3, 3), model="none"), writer)
    return sandbox.missing


def read_progress(path: Path, start: int) -> tuple[list[dict[str, Any]], int]:
    """What was told at `path` from byte `start` on, and the byte to go on from: a line that is still being written is
    left for later.
    """
    try:
        with path.open("rb") as file:
            file.seek(start)
            whole = file.read().rpartition(b"\n")[0]
    except FileNotFoundError:
        return [], start
    return [json.loads(line) for line in whole.splitlines()], start + (len(whole) + 1 if whole else 0)
