"""Worker processes. Each runs one task at a time, within limits, and is replaced if it fails and after many tasks."""

from __future__ import annotations

import logging
import os
import queue
import shutil
import signal
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING

from ciir.errors import Cancelled, TimedOut, WorkerDied
from ciir.service import memory
from ciir.service.jobs.job import INTERNAL_ERROR, Problem
from ciir.service.jobs.workers.messages import Done, Failed, Progress, Ready, Started, quote
from ciir.service.jobs.workers.sandbox import landlock
from ciir.service.jobs.workers.task import Hooks, Outcome, Task, TaskLimits
from ciir.service.jobs.workers.worker import Worker, WorkerExitedError, describe_exit

if TYPE_CHECKING:
    from ciir.service.jobs.workers.messages import Message
    from ciir.service.settings import Settings

TICK_SECONDS = 0.05
"""How often tasks and workers are polled."""
START_SECONDS = 60.0
"""A worker that is not ready this long after its start is ended, and another one is started."""
WORKING_SHARE = 0.5
"""A task that had less processor time than this share of `job_seconds` did not time out: the machine was overloaded."""
_ATTEMPTS = 3
"""How many workers are tried for one task."""
_MAX_PAUSE = 30.0
"""Longest pause between two attempts to start a worker, in seconds."""
_NO_MEMORY = Problem(503, "No room", "the server's memory is full; try again when its other processes need less")
_NOT_RESTRICTED = "a worker process is not fully restricted: %s"
_log = logging.getLogger("ciir.pool")


@dataclass(frozen=True)
class _Run:
    """A task, its open files, and its caller's hooks."""

    task: Task
    source: IO[bytes]
    target: IO[bytes]
    hooks: Hooks


class _NotReceivedError(Exception):
    """The worker died before it received the task."""


class _MemoryTakenError(Exception):
    """The worker lacked memory, some of which its earlier tasks may have taken."""


class Pool:
    """`settings.workers` processes, each replaced when it ends. Methods can be called from any thread."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._count, self._max_tasks = settings.workers, settings.worker_jobs
        self._seconds, self._limits = settings.job_seconds, TaskLimits.from_settings(settings)
        self._idle: queue.Queue[Worker] = queue.Queue()
        self._ready: set[Worker] = set()
        self._keepers: list[threading.Thread] = []
        self._lock, self._closed = threading.Lock(), threading.Event()
        self.start_error = ""
        """Says that the last attempt to start a worker failed, in one line without paths; empty if it succeeded."""
        self._start_cause = ""
        """The cause of the last failed attempt."""

    def start(self) -> None:
        """Starts the workers in the background, unless they have been started."""
        with self._lock:
            if not self._keepers and not self._closed.is_set():
                for restriction in landlock.find_exposed(_list_private(self._settings)):
                    _log.warning(_NOT_RESTRICTED, restriction)
                self._keepers = [
                    threading.Thread(target=self._keep_worker, name=f"worker-{number}", daemon=True)
                    for number in range(self._count)
                ]
                for keeper in self._keepers:
                    keeper.start()

    def is_ready(self) -> bool:
        """Checks whether a worker has loaded the models and is alive. Starts the workers if needed."""
        self.start()
        return self.count_ready() > 0

    def count_ready(self) -> int:
        """Counts the workers that have loaded the models and are alive, idle or not."""
        return sum(worker.is_alive() for worker in self._ready.copy())

    def run(self, task: Task, hooks: Hooks) -> Outcome:
        """Waits for a worker, runs `task` in it, and returns the outcome. Starts the workers if needed.

        The outcome is a `Problem` for a task over `job_seconds` that has timed out before, and `INTERNAL_ERROR`, which
        is logged, for an unexpected exception.

        Raises `TimedOut` for the first time-out; `WorkerDied`, also for a task over `job_seconds` with less processor
        time than `WORKING_SHARE` of that; `Cancelled` when `hooks.cancelled` is set or the pool is closed; and
        `OSError` for the task's files.
        """
        self.start()
        needs_new = False
        for _ in range(_ATTEMPTS):
            with task.source.open("rb") as source, TemporaryFile(dir=task.target.parent) as target:
                worker = self._take_worker(hooks.cancelled, is_new=needs_new)
                try:
                    outcome = self._run_in(worker, _Run(task, source, target, hooks))
                except _NotReceivedError as error:
                    worker.end()
                    text = "worker process %d died before it received its task (%s); another one runs it"
                    _log.warning(text, worker.pid, error)
                except _MemoryTakenError:
                    needs_new = True
                    text = "job %s: worker process %d lacked memory after %d other tasks; a new one runs it"
                    _log.warning(text, task.id, worker.pid, worker.tasks)
                except BaseException:
                    worker.end()
                    raise
                else:  # an error of the copy, such as a full disk, ends no worker
                    if isinstance(outcome, Problem):
                        return outcome
                    return replace(outcome, size=_copy(target, task.target))
                finally:
                    self._return_worker(worker)
        raise WorkerDied(f"{_ATTEMPTS} worker processes in a row did not run the task")

    def close(self) -> None:
        """Ends all workers. From now on `run` raises `Cancelled`."""
        self._closed.set()
        for keeper in self._keepers:
            keeper.join()

    def _take_worker(self, cancelled: threading.Event, *, is_new: bool) -> Worker:
        """Waits for an idle worker.

        `is_new`: accepts only a worker that has run no task, and ends others to start new ones.
        """
        while not (cancelled.is_set() or self._closed.is_set()):
            with suppress(queue.Empty):
                worker = self._idle.get(timeout=TICK_SECONDS)
                if is_new and worker.tasks:
                    worker.end()
                elif worker.is_alive():
                    return worker
        raise Cancelled

    def _return_worker(self, worker: Worker) -> None:
        worker.tasks += 1
        if worker.tasks >= self._max_tasks:
            worker.end()
        elif worker.is_alive():
            self._idle.put(worker)

    def _run_in(self, worker: Worker, run: _Run) -> Outcome:
        """Runs a task like `run`, in a given worker.

        Raises `_NotReceivedError` or `_MemoryTakenError` if another must run it.
        """
        deadline = time.monotonic() + self._seconds
        worked_before = worker.read_cpu_seconds()
        is_received = False
        try:
            worker.send(asdict(run.task.request), [run.source.fileno(), run.target.fileno()])
            while True:
                message = worker.receive(TICK_SECONDS)
                if isinstance(message, Started) and not is_received:
                    is_received = True
                    run.hooks.begun(worker.pid)
                elif isinstance(message, Progress) and is_received:
                    run.hooks.progress(message.model_dump(exclude={"kind"}))
                elif message is not None:
                    return self._get_outcome(worker, message if is_received else None, run)
                if self._is_cancelled(run):
                    raise Cancelled
                if time.monotonic() > deadline:
                    worked = worker.read_cpu_seconds() - worked_before
                    worker.end()
                    text = f"was not done after {worked:.1f} s of processor time in {self._seconds:g} s"
                    cause = f"the job was not done after {self._seconds:g} s, the operator's limit (CIIR_JOB_SECONDS)"
                    if worked < WORKING_SHARE * self._seconds:
                        raise WorkerDied(f"{text}: the machine was overloaded", f"{cause}: the server was overloaded")
                    if not run.task.has_timed_out:
                        raise TimedOut(text, cause)
                    return _time_problem(f"not done after {self._seconds:g} s, twice (CIIR_JOB_SECONDS)")
        except WorkerExitedError as error:
            if self._is_cancelled(run):
                raise Cancelled from error
            if not is_received:
                raise _NotReceivedError(str(error)) from error
            if error.exitcode == -signal.SIGXCPU:
                text = f"took over {self._limits.cpu_seconds} s of processor time (CIIR_WORKER_CPU_SECONDS)"
                return _time_problem(text)
            raise WorkerDied(describe_exit(error.exitcode)) from error

    def _is_cancelled(self, run: _Run) -> bool:
        return run.hooks.cancelled.is_set() or self._closed.is_set()

    def _get_outcome(self, worker: Worker, last: Message | None, run: _Run) -> Outcome:
        """Returns the outcome for the last message. Raises `WorkerDied` for an unexpected message."""
        if isinstance(last, Failed):
            text = "job %s: internal error in worker process %d\n%s"
            _log.error(text, run.task.id, worker.pid, quote(last.traceback))
            return INTERNAL_ERROR
        if isinstance(last, Done):
            if last.is_out_of_memory:
                worker.end()
                if worker.tasks:
                    raise _MemoryTakenError
                if memory.may_lack(self._limits.memory):
                    return _NO_MEMORY
            if isinstance(last.outcome, Problem) or run.task.request.format in (None, last.outcome.format):
                return last.outcome
        raise WorkerDied("sent an unexpected message")

    def _keep_worker(self) -> None:
        """Starts a worker, and another one whenever it ends, until the pool is closed."""
        pause = 1.0
        while not self._closed.is_set():
            worker = None
            try:
                worker = Worker(self._limits)
                self._wait_until_ready(worker)
                pause = 1.0
                while worker.is_alive() and not self._closed.wait(TICK_SECONDS):
                    worker.log_output()
                worker.end()
                worker.log_output()
            except Exception as error:  # noqa: BLE001 - logged, and tried again
                self._log_start_error(worker, error, pause)
                self._closed.wait(pause)
                pause = min(2 * pause, _MAX_PAUSE)
            finally:
                if worker is not None:
                    self._ready.discard(worker)
                    worker.end()

    def _log_start_error(self, worker: Worker | None, error: Exception, pause: float) -> None:
        """Logs why no worker was started, with its output or the traceback unless the last cause was the same."""
        line = ""
        if worker is not None:
            worker.end()
            line = worker.last_line
        cause = f"{error}{f': {line}' if line else ''}"
        with self._lock:
            is_new, self._start_cause = cause != self._start_cause, cause
        if worker is not None and is_new:
            worker.log_output()
        traceback = error if is_new and not isinstance(error, WorkerExitedError) else None
        text = "a worker process can't be started: %s; the next attempt is in %g s"
        _log.error(text, cause, pause, exc_info=traceback)
        self.start_error = f"a worker process can't be started ({type(error).__name__}); the log says why"

    def _wait_until_ready(self, worker: Worker) -> None:
        """Waits until a worker has loaded the models, and adds it to the idle ones. Raises `WorkerExitedError`."""
        deadline = time.monotonic() + START_SECONDS
        while not self._closed.is_set():
            message = worker.receive(TICK_SECONDS)
            worker.read_output()
            if isinstance(message, Ready):
                for restriction in message.missing:
                    _log.warning(_NOT_RESTRICTED, restriction)
                self.start_error = ""
                self._ready.add(worker)
                self._idle.put(worker)
                return
            if time.monotonic() > deadline:
                worker.end()
                raise WorkerExitedError(-signal.SIGKILL, f"it was not ready after {START_SECONDS:g} s")


def _list_private(settings: Settings) -> dict[str, Path]:
    """Returns the folders of jobs and files of secrets, by the names of their settings."""
    named = {
        "CIIR_FOLDER": settings.find_folder(),
        "CIIR_FILES": None if "://" in settings.files else settings.files,
        "CIIR_API_KEYS_FILE": settings.api_keys_file,
        "CIIR_QUEUE_FILE": settings.queue_file,
        "AWS_SHARED_CREDENTIALS_FILE": os.environ.get("AWS_SHARED_CREDENTIALS_FILE"),
    }
    return {name: Path(path) for name, path in named.items() if path}


def _copy(file: IO[bytes], target: Path) -> int:
    """Copies all of `file`, and returns its size. Even if the worker has kept `file` open, it can't change the copy."""
    file.seek(0)
    with target.open("wb") as out:
        shutil.copyfileobj(file, out, 1 << 20)
        return out.tell()


def _time_problem(reason: str) -> Problem:
    detail = f"{reason}, the operator's limit; ask for fewer views, or give a smaller input"
    return Problem(422, "Takes too long", detail)
