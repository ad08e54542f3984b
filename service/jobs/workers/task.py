"""The task of a worker process: from an input file and a request to a result file.

The parent process imports this module too, so imports that the job needs are in the functions that use them.
"""

from __future__ import annotations

import errno
import json
from dataclasses import dataclass
from io import SEEK_END
from typing import IO, TYPE_CHECKING, Any

from ciir.errors import Error
from ciir.renderer.limits import Limits
from ciir.service.errors import find_response, join_lines
from ciir.service.jobs.job import NO_ROOM, Problem, Request, Result
from ciir.service.jobs.resource import is_full
from ciir.service.jobs.workers.progress import ProgressClock

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable
    from pathlib import Path

    from ciir.service.settings import Settings

Outcome = Result | Problem
_OVER = "Over a limit"
_WARM_GRID, _WARM_SIDE = (3, 3), 32
"""Views and pixels of the smallest light field, used to warm up the models."""
_WARM_MESH = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@dataclass(frozen=True)
class TaskLimits:
    """Limits on a task's input and on what it may use."""

    limits: Limits
    """Limits on the input."""
    output_pixels: int
    """Most output pixels of all views together, and most samples of a mesh."""
    memory: int
    """Bytes of address space, enforced by `service.jobs.workers.sandbox`."""
    file: int
    """Bytes of the result, also enforced there."""
    cpu_seconds: int
    """Processor time."""

    @classmethod
    def from_settings(cls, settings: Settings) -> TaskLimits:
        """Returns the limits given by the settings."""
        return cls(
            settings.limits,
            settings.max_output_pixels,
            settings.worker_memory_bytes,
            settings.worker_file_bytes,
            settings.worker_cpu_seconds,
        )

    @classmethod
    def from_json(cls, fields: dict[str, Any]) -> TaskLimits:
        """Restores limits from the `fields` made by `dataclasses.asdict`."""
        return cls(**fields | {"limits": Limits(**fields["limits"])})


@dataclass(frozen=True)
class Task:
    """A job to run."""

    id: str
    """The id of the job."""
    request: Request
    source: Path
    """The input."""
    target: Path
    """Where to write the result. Unless the outcome is a `Result`, the file may be incomplete or missing."""
    has_timed_out: bool = False
    """Whether an earlier run of the job timed out."""


@dataclass(frozen=True)
class Hooks:
    """How the caller of a pool follows a task and stops it. The functions are called in the thread of `Pool.run`."""

    begun: Callable[[int], None]
    """Gets the worker's process id once the worker has received the task."""
    progress: Callable[[dict[str, Any]], None]
    """Gets the data of each progress event."""
    cancelled: threading.Event
    """Stops the task once it is set."""


@dataclass(frozen=True)
class Finished:
    """What a task returns."""

    outcome: Outcome
    is_out_of_memory: bool = False
    """If so, the process must be replaced: it may have less memory left than the next task needs."""


def run_task(
    request: Request,
    source: IO[bytes],
    target: IO[bytes],
    limits: TaskLimits,
    progress: Callable[[dict[str, Any]], None],
) -> Finished:
    """Runs the job in this process, from the open file `source` to `target`; `progress` gets the data of each event.

    Errors in the input, limits on memory or file size, and a full disk result in a `Problem`; other exceptions are
    raised.
    """
    from ciir.service.jobs.workers.sandbox import restrictions

    restrictions.allow_cpu(limits.cpu_seconds)
    try:
        return Finished(write_result(request, source, target, limits, progress))
    except Error as error:
        response = find_response(error)
        problem = Problem(response.status, response.title, join_lines(str(error)))
        return Finished(problem, _is_out_of_memory(error))
    except Exception as error:
        found = _find_resource_problem(error, limits)
        if found is None:
            raise
        return Finished(found, _is_out_of_memory(error))


def _find_resource_problem(error: Exception, limits: TaskLimits) -> Problem | None:
    """Returns the problem if `error` is a lack of memory or disk space, else None."""
    code = getattr(error, "errno", None)
    if code == errno.EFBIG:
        detail = f"the result is over {limits.file:,} bytes; ask for fewer views or a smaller scale"
        return Problem(413, _OVER, detail)
    if is_full(error):
        return NO_ROOM
    if _is_out_of_memory(error):
        detail = f"this takes more than {limits.memory:,} bytes of memory; give a smaller input, or ask for fewer views"
        return Problem(413, _OVER, detail)
    return None


def _is_out_of_memory(error: BaseException) -> bool:
    """Checks whether `error` or its cause is a lack of memory, which C++ libraries report only in the message."""
    message = str(error).lower()
    return (
        isinstance(error, MemoryError)
        or getattr(error, "errno", None) == errno.ENOMEM
        or any(text in message for text in ("bad_alloc", "bad allocation", "allocate memory"))
        or (error.__cause__ is not None and _is_out_of_memory(error.__cause__))
    )


def write_result(
    request: Request,
    source: IO[bytes],
    target: IO[bytes],
    limits: TaskLimits,
    progress: Callable[[dict[str, Any]], None],
) -> Result:
    """Runs the job like `run_task`, but lets the pipeline's exceptions through."""
    from ciir.service.pipeline import one_file
    from ciir.service.pipeline.options import KINDS

    given = one_file.open_upload(request.kind, request.name, source.read(), limits.limits)
    clock = ProgressClock(progress)
    output = one_file.Output(target, request.format, limits.output_pixels, clock.count_views, clock)
    name, report = one_file.RUNS[request.kind](given, KINDS[request.kind].parse(request.options), output)
    views = report.pop("views", None)  # each poll parses the record, and there can be 65,536 views
    stored = json.loads(json.dumps(report, allow_nan=False))  # turns tuples into lists, as in a record
    target.flush()
    return Result(name, target.seek(0, SEEK_END), stored, views=1 if views is None else len(views))


def warm_up() -> None:
    """Loads what most tasks need, and runs each model that `auto` may select, for one view and many: takes 1 to 2 s."""
    import io

    import numpy as np

    from ciir.cores import count_available_cores
    from ciir.models import catalogue
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.views import parse_views
    from ciir.renderer.writers.file_writer import FileWriter
    from ciir.service.pipeline import run as pipeline
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.planning.plan import Plan
    from ciir.service.pipeline.stages import upscaling
    from ciir.service.pipeline.stages.arrangement import Arrangement

    view = np.zeros((_WARM_SIDE, _WARM_SIDE, 3), np.uint8)
    for model, is_light_field in (
        (catalogue.picture_default_name(), False),
        (catalogue.light_field_default_name(), True),
    ):
        if model in catalogue.list_names():
            plan = Plan("upscale", model, 2, 1, (), is_light_field)
            run = upscaling.load_upscaler(plan, Arrangement(_WARM_GRID), skip=False)
            every = parse_views("all", *_WARM_GRID)
            # One view uses all cores; many views use one each, in separate sessions. Single pictures are processed in
            # batches.
            many = every if is_light_field else every * 2 * count_available_cores()
            for wanted in ([(1, 1)], many):
                run(dict.fromkeys(every, view), wanted)
    mesh = Bundle.from_upload("mesh.off", _WARM_MESH)
    with FileWriter(io.BytesIO(), "png") as writer:
        pipeline.reconstruct(mesh, Options(lenses=(8, 8), pixels=(3, 3), model="none"), writer)
