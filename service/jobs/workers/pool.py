"""Worker processes: each runs one task at a time, within limits, and is replaced when it fails or after `worker_jobs`.

pebble starts and kills the processes and detects their deaths. Each process has a pebble pool of its own: the processes
of one pool share a pipe and its lock, which a dead one may hold. pebble has no setting for these, done here:

- a time limit on a monotonic clock (the `timeout` of `schedule` follows the system clock) and progress meanwhile;
- no task for a process that has not loaded its models yet;
- a new process in place of one that died idle (which breaks a pebble pool), and pauses while starting one fails.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import queue
import signal
import threading
import time
from concurrent.futures import wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from pebble import CONSTS, ProcessExpired, ProcessPool

from ciir.errors import Cancelled, WorkerDied
from ciir.service.jobs.job import INTERNAL_ERROR, Problem
from ciir.service.jobs.workers import sandbox
from ciir.service.jobs.workers.progress import read_progress
from ciir.service.jobs.workers.task import Finished, Outcome, Task, TaskLimits, run_task, warm_up

if TYPE_CHECKING:
    from collections.abc import Callable

    from pebble import ProcessFuture

    from ciir.service.settings import Settings

TICK_SECONDS = 0.05
"""How often tasks and workers are polled."""
_ATTEMPTS = 3
"""Workers that are tried for one task, where each dies before it receives the task."""
_MAX_PAUSE = 30.0
"""Longest pause between two attempts to start a worker, in seconds."""
CONSTS.term_timeout = 0.0  # workers ignore SIGTERM (service.jobs.workers.sandbox): send SIGKILL
_log = logging.getLogger("ciir.pool")


class _Worker:
    """A worker process and its pebble pool."""

    def __init__(self, limits: TaskLimits) -> None:
        self._pool = ProcessPool(
            1,
            initializer=sandbox.enter,
            initargs=(limits.memory, limits.file, os.getpid()),
            context=multiprocessing.get_context("spawn"),
        )
        self._lock = threading.Lock()
        self.tasks = 0
        """Tasks that it has run."""

    def call(self, function: Callable[..., Any], *args: object) -> ProcessFuture[Any]:
        """Calls a module's function in the process; raises `BrokenProcessPool` if that is dead."""
        try:
            future: ProcessFuture[Any] = self._pool.schedule(function, args=args)
        except RuntimeError as error:
            raise BrokenProcessPool(str(error)) from error
        return future

    def is_alive(self) -> bool:
        """Whether it accepts tasks."""
        return self._pool.active

    def end(self) -> None:
        """Kills the process, if it is alive, and waits until it is dead."""
        with self._lock:
            self._pool.stop()  # type: ignore[no-untyped-call]
            self._pool.join()


class Pool:
    """`settings.workers` processes, each replaced when it ends. Methods may be called from any thread."""

    def __init__(self, settings: Settings) -> None:
        self._count, self._max_tasks = settings.workers, settings.worker_jobs
        self._seconds, self._limits = settings.job_seconds, TaskLimits.from_settings(settings)
        self._idle: queue.Queue[_Worker] = queue.Queue()
        self._ready: set[_Worker] = set()
        self._keepers: list[threading.Thread] = []
        self._lock, self._closed = threading.Lock(), threading.Event()

    def start(self) -> None:
        """Starts the workers in the background, unless that has been done."""
        with self._lock:
            if not self._keepers and not self._closed.is_set():
                self._keepers = [
                    threading.Thread(target=self._keep_worker, name=f"worker-{number}", daemon=True)
                    for number in range(self._count)
                ]
                for keeper in self._keepers:
                    keeper.start()

    def is_ready(self) -> bool:
        """Whether a worker has loaded the models and is alive; starts the workers if needed."""
        self.start()
        return self.count_ready() > 0

    def count_ready(self) -> int:
        """How many workers have loaded the models and are alive, idle or not."""
        return sum(worker.is_alive() for worker in self._ready.copy())

    def run(self, task: Task, *, progress: Callable[[dict[str, Any]], None], cancelled: threading.Event) -> Outcome:
        """Waits for a worker, has it run `task`, and returns the outcome; starts the workers if needed.

        Calls `progress` in this thread with the data of each progress event. A task over `job_seconds` is stopped and
        gives a `Problem`; an unexpected exception gives `INTERNAL_ERROR` and is logged.

        Raises `WorkerDied`; `Cancelled` when `cancelled` is set or the pool is closed.
        """
        self.start()
        for _ in range(_ATTEMPTS):
            worker = self._take_worker(cancelled)
            try:
                return self._run_in(worker, task, progress, cancelled)
            except BrokenProcessPool as error:
                worker.end()
                _log.warning("a worker process died before it received its task (%s); another one runs it", error)
            except BaseException:
                worker.end()
                raise
            finally:
                self._return_worker(worker)
        raise WorkerDied(f"{_ATTEMPTS} worker processes in a row died before they received the task")

    def close(self) -> None:
        """Ends all workers; `run` raises `Cancelled` from now on."""
        self._closed.set()
        for keeper in self._keepers:
            keeper.join()

    def _take_worker(self, cancelled: threading.Event) -> _Worker:
        while not (cancelled.is_set() or self._closed.is_set()):
            with suppress(queue.Empty):
                worker = self._idle.get(timeout=TICK_SECONDS)
                if worker.is_alive():
                    return worker
        raise Cancelled

    def _return_worker(self, worker: _Worker) -> None:
        worker.tasks += 1
        if worker.tasks >= self._max_tasks:
            worker.end()
        elif worker.is_alive():
            self._idle.put(worker)

    def _run_in(
        self, worker: _Worker, task: Task, progress: Callable[[dict[str, Any]], None], cancelled: threading.Event
    ) -> Outcome:
        """As `run`, in a given worker; raises `BrokenProcessPool` if it died before it received the task."""
        deadline = time.monotonic() + self._seconds
        future = worker.call(run_task, task, self._limits)
        offset = 0
        is_done = False
        while not is_done:
            wait([future], timeout=TICK_SECONDS)
            is_done = future.done()
            events, offset = read_progress(task.progress, offset)
            for data in events:
                progress(data)
            if not is_done and (cancelled.is_set() or self._closed.is_set()):
                raise Cancelled
            if not is_done and time.monotonic() > deadline:
                worker.end()
                return _time_problem(f"not done after {self._seconds:g} s")
        return self._get_outcome(worker, future, task)

    def _get_outcome(self, worker: _Worker, future: ProcessFuture[Any], task: Task) -> Outcome:
        try:
            finished: Finished = future.result()
        except ProcessExpired as error:
            if error.exitcode == -signal.SIGXCPU:
                return _time_problem(f"took over {self._limits.cpu_seconds} s of processor time")
            raise WorkerDied(_describe_exit(error.exitcode)) from error
        except BrokenProcessPool:
            raise
        except Exception:  # noqa: BLE001 - any error in the task that is not an error in its input
            _log.exception("job %s: internal error", task.id)
            return INTERNAL_ERROR
        if finished.is_out_of_memory:
            worker.end()
        return finished.outcome

    def _keep_worker(self) -> None:
        """Starts a worker, and another one whenever it ends, until the pool is closed."""
        pause = 1.0
        while not self._closed.is_set():
            worker = _Worker(self._limits)
            try:
                self._warm_up(worker)
                pause = 1.0
                while worker.is_alive() and not self._closed.wait(TICK_SECONDS):
                    pass
            except Exception as error:  # noqa: BLE001 - logged, and tried again
                has_died = isinstance(error, ProcessExpired | BrokenProcessPool)  # then a traceback shows nothing
                text = "a worker process can't be started (%s: %s); the next attempt is in %g s"
                _log.error(text, type(error).__name__, error, pause, exc_info=None if has_died else error)
                self._closed.wait(pause)
                pause = min(2 * pause, _MAX_PAUSE)
            finally:
                self._ready.discard(worker)
                worker.end()

    def _warm_up(self, worker: _Worker) -> None:
        """Makes a worker load the models and adds it to the idle ones. Raises whatever `warm_up` does."""
        future = worker.call(warm_up)
        while not self._closed.is_set():
            wait([future], timeout=TICK_SECONDS)
            if future.done():
                for restriction in future.result():
                    _log.warning("a worker process is not fully restricted: %s", restriction)
                self._ready.add(worker)
                self._idle.put(worker)
                return


def _time_problem(reason: str) -> Problem:
    return Problem(422, "Takes too long", f"{reason}, the limit; ask for fewer views, or give a smaller input")


def _describe_exit(exitcode: int) -> str:
    """`was ended by signal 9 (Killed)`, `ended with status 1`."""
    if exitcode >= 0:
        return f"ended with status {exitcode}"
    return f"was ended by signal {-exitcode} ({signal.strsignal(-exitcode)})"
