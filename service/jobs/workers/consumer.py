"""Takes jobs off the queue and has a worker process do each: a few threads, and one that looks after all of it."""

from __future__ import annotations

import logging
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from ciir.errors import Cancelled, QueueUnavailable, WorkerDied
from ciir.service.jobs import lanes
from ciir.service.jobs.job import Problem, Result
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.recovery import BEAT_SECONDS, Watch, claim_of
from ciir.service.jobs.workers.task import Task

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.service.jobs.job import Job
    from ciir.service.jobs.jobs import Jobs
    from ciir.service.jobs.workers.task import Outcome

TAKE_SECONDS = 0.5
"""How long a thread waits for a job before it looks whether it is to stop."""
RETRY_SECONDS = 0.5
LOOK_SECONDS = 0.25
"""Between two events of progress of a job, and until its work stops when it was cancelled."""
SWEEP_SECONDS = 30.0
PROGRESS_EVENTS = 240
"""Events of progress in a job's first minute, four a second; later one for each 240th part of its age, so that what is
known of a job that takes hours stays small."""
FAULT = Problem(500, "Fault", "the server is at fault; its log says more")
_log = logging.getLogger("ciir.jobs")


class Runner(Protocol):
    """What does the work: `service.jobs.workers.pool.Pool`."""

    def run(self, work: Task, *, progress: Callable[[dict[str, Any]], None], cancelled: threading.Event) -> Outcome:
        """As `Pool.run`; called by several threads at once."""
        ...


class Consumer:
    """Threads that run jobs, `threads` at once."""

    def __init__(self, jobs: Jobs, pool: Runner, threads: int) -> None:
        self._jobs, self._pool = jobs, pool
        self._owner = ConsumerLock(jobs.folder)
        self._watch = Watch(jobs, self._owner)
        self._stopping = threading.Event()
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._count = 0
        self._running: dict[str, _Run] = {}
        """By claim."""
        self._threads = [
            threading.Thread(target=self._consume, args=(index, threads), name=f"consumer-{index}", daemon=True)
            for index in range(threads)
        ]
        self._watcher = threading.Thread(target=self._look_after, name="consumer-watch", daemon=True)

    def start(self) -> None:
        """Begins to take jobs, and to look after those of consumers that have ended."""
        self._watcher.start()
        for thread in self._threads:
            thread.start()

    def stop(self, seconds: float) -> None:
        """Takes no more, lets what runs finish within `seconds`, and puts the rest back into the queue."""
        until = time.monotonic() + seconds
        self._stopping.set()
        if self._watcher.is_alive():
            self._end(until)
        self._owner.close()

    def _end(self, until: float) -> None:
        self._jobs.queue.wake()
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))
        while any(thread.is_alive() for thread in self._threads):
            with self._lock:
                for run in self._running.values():  # one may have been taken off the queue just before
                    run.stop.set()
            for thread in self._threads:
                thread.join(LOOK_SECONDS / len(self._threads))
        self._ended.set()
        self._watcher.join()
        try:
            self._jobs.queue.beats.remove(self._owner.name)
        except QueueUnavailable as error:
            _log.warning("the queue doesn't know yet that this consumer has ended: %s", error)

    def _consume(self, index: int, threads: int) -> None:
        turn = 0
        while not self._stopping.is_set():
            try:
                id_ = self._jobs.queue.pop(lanes.order(index, threads, turn), TAKE_SECONDS)
                run = self._begin(id_) if id_ is not None else None
                if run is not None:
                    turn += 1
                    self._do(run)
            except QueueUnavailable:  # it is in the log
                self._stopping.wait(RETRY_SECONDS)
            except Exception:  # noqa: BLE001 - told; the thread has to go on, and `Watch` has the job run again
                _log.exception("a fault of the server, while a job was taken or its end was told")
                self._stopping.wait(RETRY_SECONDS)

    def _begin(self, id_: str) -> _Run | None:
        with self._lock:
            self._count += 1
            claim = claim_of(self._owner.name, self._count)
        job = self._jobs.lifecycle.begin(id_, claim)
        if job is None:  # it was cancelled, or stood in the queue twice
            return None
        run = _Run(job)
        with self._lock:
            self._running[claim] = run
        return run

    def _do(self, run: _Run) -> None:
        """Runs a job to its end, whatever that is, and tells the queue."""
        try:
            outcome = self._outcome(run)
            while not self._told(run.job, outcome):
                if self._stopping.wait(RETRY_SECONDS):
                    _log.warning("job %s: its end can't be told; it is run again", run.job.id)
                    break
            if isinstance(outcome, Cancelled) and not run.stop.is_set():  # the pool is closed: no need to hurry
                self._stopping.wait(RETRY_SECONDS)
        finally:
            with self._lock:
                del self._running[run.job.claim]

    def _outcome(self, run: _Run) -> Result | Problem | Cancelled | WorkerDied:
        job = run.job
        try:
            with self._jobs.files.run(job.input, job.output) as place:
                work = Task(job.id, job.request, place.source, place.target)
                progress = partial(run.tell, self._jobs)
                outcome = self._pool.run(work, progress=progress, cancelled=run.stop)
                if isinstance(outcome, Result):
                    place.keep()
                return outcome
        except (Cancelled, WorkerDied) as reason:
            return reason
        except QueueUnavailable as error:
            return Problem(503, "Not available", str(error))
        except FileNotFoundError:
            _log.exception("job %s: its input is gone; machines that share a queue must share CIIR_FILES, too", job.id)
            return Problem(503, "Not available", "the input isn't kept any more; post it again")
        except OSError as error:
            _log.exception("job %s: its files can't be used", job.id)
            return Problem(
                503, "Not available", f"the server's files can't be used ({error.strerror}); ask again later"
            )
        except Exception:  # noqa: BLE001 - told, and the job's end
            _log.exception("job %s: a fault of the server", job.id)
            return FAULT

    def _told(self, run: Job, outcome: Result | Problem | Cancelled | WorkerDied) -> bool:
        """Writes the run's end down; False where the queue can't be reached."""
        try:
            if isinstance(outcome, Result | Problem):
                if not self._jobs.lifecycle.finish(run, outcome):
                    _log.info("job %s: cancelled, or taken over by another consumer", run.id)
            elif isinstance(outcome, WorkerDied):
                _log.warning("job %s: %s", run.id, outcome)
                self._jobs.lifecycle.worker_died(run)
            else:
                self._jobs.lifecycle.again(run)  # which does nothing where it was cancelled
        except QueueUnavailable:
            return False
        return True

    def _look_after(self) -> None:
        """Beats, mends, passes progress on, hears of jobs that were cancelled, sweeps: each in its own time."""
        looked = swept = float("-inf")
        is_tidy = False
        while not self._ended.wait(LOOK_SECONDS):
            now = time.monotonic()
            try:
                if now - looked >= BEAT_SECONDS:
                    looked = now
                    self._watch.beat()
                    self._watch.look(self._claims())
                    if not is_tidy:
                        self._watch.tidy()
                        is_tidy = True
                self._look_at_runs()
                if now - swept >= SWEEP_SECONDS:
                    swept = now
                    if not self._jobs.sweep():
                        swept = float("-inf")  # the rest once this consumer has said that it lives
            except QueueUnavailable:
                continue
            except Exception:  # noqa: BLE001 - likewise
                _log.exception("a fault of the server, while it looked after the queue")

    def _claims(self) -> set[str]:
        with self._lock:
            return set(self._running)

    def _look_at_runs(self) -> None:
        with self._lock:
            running = list(self._running.values())
        jobs = self._jobs.records.many([run.job.id for run in running])
        for run in running:
            now = jobs.get(run.job.id)
            if now is None or now.claim != run.job.claim or now.state != "running":
                run.stop.set()
            else:
                run.pass_on(self._jobs)


class _Run:
    """One run of a job, and how far it is."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.stop = threading.Event()
        """Stops its work."""
        self._lock = threading.Lock()
        self._newest: dict[str, Any] | None = None
        self._told: dict[str, Any] | None = None
        self._begun = self._last = time.monotonic()

    def tell(self, jobs: Jobs, data: dict[str, Any]) -> None:
        """Called by the worker's pool: passes the first on, and keeps the newest of the others for `pass_on`."""
        self._newest = data
        if self._told is None:
            self.pass_on(jobs)

    def pass_on(self, jobs: Jobs) -> None:
        """Adds what is new since the last call to the job's events; stops the work where nobody wants it any more."""
        with self._lock:
            data, now = self._newest, time.monotonic()
            is_soon = self._told is not None and now - self._last < (now - self._begun) / PROGRESS_EVENTS
            if data is None or data == self._told or is_soon:
                return
            self._told, self._last = data, now
        try:
            if not jobs.lifecycle.progress(self.job, data):
                self.stop.set()
        except QueueUnavailable as error:
            _log.warning("job %s: its progress isn't told: %s", self.job.id, error)
