"""Worker processes: each does one piece of work at a time, within limits, and is replaced when it fails or is spent.

Each is a pebble pool of one process, so that no worker's death can harm another's: workers of one pool share a pipe and
its lock. Time is measured here and not by pebble, which asks the clock on the wall.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import queue
import signal
import threading
import time
from concurrent.futures import wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pebble import CONSTS, ProcessExpired, ProcessPool

from ciir.errors import Cancelled, WorkerDied
from ciir.service.jobs.job import Problem, Result
from ciir.service.jobs.workers import sandbox
from ciir.service.jobs.workers.task import Done, Outcome, Task, TaskLimits, read_progress, run_task, warm_up

if TYPE_CHECKING:
    from collections.abc import Callable

    from pebble import ProcessFuture

    from ciir.service.settings import Settings

TICK_SECONDS = 0.05
"""How often a piece of work that runs is looked at: for progress, for its time, and whether it is still wanted."""
WATCH_SECONDS = 0.5
"""How often workers that wait are looked at."""
_MOST_PAUSE = 30.0
"""Most seconds between two attempts to start a worker that fails to."""
_ATTEMPTS = 3
"""So many workers in a row may die between two pieces of work before one of them is told of it."""
CONSTS.term_timeout = 0.0  # workers ignore SIGTERM (service.jobs.workers.sandbox): SIGKILL follows at once
_log = logging.getLogger("ciir.pool")


class _Worker:
    """A process, from its start to its end."""

    def __init__(self, allowed: TaskLimits) -> None:
        bounds = sandbox.Bounds(allowed.memory, allowed.file)
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPool(1, initializer=sandbox.enter, initargs=(bounds, os.getpid()), context=context)
        self._lock = threading.Lock()
        self.done = 0
        """Pieces of work."""
        self.ended = threading.Event()
        """Once it is dead, or known to be."""

    def call(self, function: Callable[..., Any], *args: object) -> ProcessFuture[Any]:
        """Has the process call a function of a module; raises `RuntimeError` where it is dead."""
        future: ProcessFuture[Any] = self._pool.schedule(function, args=args)
        return future

    def is_alive(self) -> bool:
        """Whether it can be given work."""
        return not self.ended.is_set() and self._pool.active

    def end(self) -> None:
        """Ends the process, whatever it does, and waits until it is dead."""
        with self._lock:
            if not self.ended.is_set():
                self._pool.stop()  # type: ignore[no-untyped-call]
                self._pool.join()
                self.ended.set()


class Pool:
    """`settings.workers` processes, each started anew whenever it ends. Methods may be called from any thread."""

    def __init__(self, settings: Settings) -> None:
        self._count, self._most_jobs = settings.workers, settings.worker_jobs
        self._seconds, self._allowed = settings.job_seconds, TaskLimits.from_settings(settings)
        self._free: queue.Queue[_Worker] = queue.Queue()
        self._warm: set[_Worker] = set()
        self._keepers: list[threading.Thread] = []
        self._lock, self._closed = threading.Lock(), threading.Event()
        self.trouble = ""
        """Why the last worker that should have started did not, in words; empty since one did."""

    def start(self) -> None:
        """Begins to start the workers, unless that has been done; `ready` says when there are any."""
        with self._lock:
            if not self._keepers and not self._closed.is_set():
                self._keepers = [
                    threading.Thread(target=self._keep, name=f"worker-{number}", daemon=True)
                    for number in range(self._count)
                ]
                for keeper in self._keepers:
                    keeper.start()

    def is_ready(self) -> bool:
        """Whether there is a worker that has loaded the models and lives; starts them where nobody has."""
        self.start()
        return self.count_ready() > 0

    def count_ready(self) -> int:
        """How many workers have loaded the models and live, at work or not."""
        return sum(worker.is_alive() for worker in self._warm.copy())

    def run(self, work: Task, *, progress: Callable[[dict[str, Any]], None], cancelled: threading.Event) -> Outcome:
        """Waits for a worker, has it do `work`, and returns what came of it; starts the workers where nobody has.

        `progress` is called in this thread with the data of `progress` events. What takes over `job_seconds` is
        stopped: a `Problem`, as is a fault of this program (500), of which the log tells more.

        Raises `WorkerDied`; `Cancelled` when `cancelled` is set or the pool is closed.
        """
        self.start()
        for _ in range(_ATTEMPTS):
            worker = self._take(cancelled)
            try:
                return self._watched(worker, work, progress, cancelled)
            except _NotBegunError as error:
                worker.end()
                _log.warning("a worker process ended before its work began (%s); another one does it", error)
            except BaseException:
                worker.end()
                raise
            finally:
                self._give_back(worker)
        raise WorkerDied(f"{_ATTEMPTS} worker processes in a row ended before their work began")

    def close(self) -> None:
        """Ends all workers; `run` raises `Cancelled` from now on."""
        self._closed.set()
        for worker in self._warm.copy():
            worker.end()
        for keeper in self._keepers:
            keeper.join()

    def _take(self, cancelled: threading.Event) -> _Worker:
        while not (cancelled.is_set() or self._closed.is_set()):
            try:
                worker = self._free.get(timeout=TICK_SECONDS)
            except queue.Empty:
                continue
            if worker.is_alive():
                return worker
            worker.end()
        raise Cancelled

    def _give_back(self, worker: _Worker) -> None:
        worker.done += 1
        if worker.done >= self._most_jobs or not worker.is_alive():
            worker.end()
        else:
            self._free.put(worker)

    def _watched(
        self,
        worker: _Worker,
        work: Task,
        progress: Callable[[dict[str, Any]], None],
        cancelled: threading.Event,
    ) -> Outcome:
        """As `run`, with a worker that is there, and with which something is wrong where anything is raised."""
        try:
            future = worker.call(run_task, work, self._allowed)
        except RuntimeError as error:
            raise _NotBegunError(str(error)) from error
        begun: float | None = None
        read = 0
        while True:
            wait([future], timeout=TICK_SECONDS)
            is_done = future.done()
            told, read = read_progress(work.told, read)
            for data in told:
                progress(data)
            if is_done:
                break
            if cancelled.is_set() or self._closed.is_set():
                raise Cancelled
            if begun is None and future.running():
                begun = time.monotonic()
            if begun is not None and time.monotonic() - begun > self._seconds:
                worker.end()
                return Problem(
                    422,
                    "Takes too long",
                    f"not done after {self._seconds:g} s, the limit; ask for fewer views, or give a smaller input",
                )
        return self._outcome(worker, future, work)

    def _outcome(self, worker: _Worker, future: ProcessFuture[Any], work: Task) -> Outcome:
        try:
            done: Done = future.result()
        except ProcessExpired as error:
            if error.exitcode == -signal.SIGXCPU:
                return Problem(
                    422,
                    "Takes too long",
                    f"took over {self._allowed.cpu_seconds} s of processor time, the limit; ask for fewer views, "
                    "or give a smaller input",
                )
            raise WorkerDied(_cause(error.exitcode)) from error
        except BrokenProcessPool as error:
            raise _NotBegunError(str(error)) from error
        except Exception:  # noqa: BLE001 - whatever the work may raise that nobody has thought of
            _log.exception("work %s failed by a fault of this program", work.id)
            return Problem(500, "Internal error", "the reconstruction failed; the server's log says why")
        if done.is_spent:
            worker.end()
        if isinstance(done.outcome, Result):
            return replace(done.outcome, report=json.loads(work.report.read_bytes()))
        return done.outcome

    def _keep(self) -> None:
        """One after another: starts a worker, has it load the models, and waits until it has ended."""
        pause = 1.0
        while not self._closed.is_set():
            worker = _Worker(self._allowed)
            try:
                missing = self._started(worker)
                self.trouble, pause = "", 1.0
                for line in missing:
                    _log.warning("a worker process is not kept in: %s", line)
                self._warm.add(worker)
                self._free.put(worker)
                while worker.is_alive() and not self._closed.is_set():
                    worker.ended.wait(WATCH_SECONDS)
            except Exception as error:  # noqa: BLE001 - told, and tried again
                self.trouble = f"a worker process can't be started ({type(error).__name__}: {error})"
                is_known = isinstance(error, ProcessExpired | BrokenProcessPool)  # it died: there is no more to tell
                _log.error("%s; the next attempt is in %g s", self.trouble, pause, exc_info=None if is_known else error)
                self._closed.wait(pause)
                pause = min(2 * pause, _MOST_PAUSE)
            finally:
                self._warm.discard(worker)
                worker.end()

    def _started(self, worker: _Worker) -> list[str]:
        """Once it has loaded the models: what it isn't kept from. Raises what went wrong."""
        future = worker.call(warm_up)
        while not future.done() and not self._closed.is_set():
            wait([future], timeout=TICK_SECONDS)
        missing: list[str] = [] if self._closed.is_set() else future.result()
        return missing


class _NotBegunError(Exception):
    """The worker was dead before the work began: no fault of the work's."""


def _cause(exitcode: int) -> str:
    """`was ended by signal 9 (Killed)`, `ended with status 1`."""
    if exitcode >= 0:
        return f"ended with status {exitcode}"
    return f"was ended by signal {-exitcode} ({signal.strsignal(-exitcode)})"
