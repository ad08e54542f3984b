"""Threads that take jobs off the queue and run each in a worker process, and a thread for heartbeats and recovery."""

from __future__ import annotations

import json
import logging
import threading
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ciir.errors import Cancelled, QueueUnavailable, TimedOut, WorkerDied
from ciir.service.errors import find_response
from ciir.service.jobs.job import INTERNAL_ERROR, NO_ROOM, Problem, Result
from ciir.service.jobs.lanes import SMALL_SECONDS, order_lanes
from ciir.service.jobs.resource import is_full
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.recovery import HEARTBEAT_SECONDS, Recovery, create_lease
from ciir.service.jobs.workers.task import Hooks, Task
from ciir.service.logs import FIELDS, REQUEST_ID

if TYPE_CHECKING:
    from ciir.service.jobs.job import Job
    from ciir.service.jobs.jobs import Jobs
    from ciir.service.jobs.workers.counting_pool import CountingPool

POP_SECONDS = 0.5
"""How long a thread waits for a job before it checks whether to stop."""
RETRY_SECONDS = 0.5
CHECK_SECONDS = 0.25
"""Time between two progress events of a job, and the longest time until its work stops after it was cancelled."""
SWEEP_SECONDS = 30.0
PROGRESS_EVENTS = 240
"""Progress events in a job's first minute, four a second. Later there is one for each 240th part of its age, so that
the record of a job that takes hours stays small."""
LOST = "it was cancelled, or taken over by another consumer"
"""Why a run has lost its lease."""
_log = logging.getLogger("ciir.jobs")


class Consumer:
    """Runs jobs in `threads` threads."""

    def __init__(self, jobs: Jobs, pool: CountingPool, threads: int) -> None:
        self._jobs, self._pool = jobs, pool
        self._lock_file = ConsumerLock(jobs.folder)
        self._recovery = Recovery(jobs, self._lock_file)
        self._stopping = threading.Event()
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._leases = 0
        self._runs: dict[str, _Run] = {}
        """Runs by lease."""
        self._threads = [
            threading.Thread(target=self._run_jobs, args=(index, threads), name=f"consumer-{index}", daemon=True)
            for index in range(threads)
        ]
        self._monitor = threading.Thread(target=self._monitor_jobs, name="consumer-monitor", daemon=True)

    def start(self) -> None:
        """Starts the threads."""
        self._monitor.start()
        for thread in self._threads:
            thread.start()

    def count_others(self) -> int:
        """Counts the other consumers that take jobs from the same folder."""
        return self._lock_file.count_others()

    def stop(self, seconds: float) -> None:
        """Takes no more jobs, lets running ones finish within `seconds`, and puts the rest back into the queue."""
        deadline = time.monotonic() + seconds
        self._stopping.set()
        if self._monitor.is_alive():
            self._stop_threads(deadline)
        self._lock_file.close()

    def _stop_threads(self, deadline: float) -> None:
        self._jobs.queue.wake()
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))
        while any(thread.is_alive() for thread in self._threads):
            with self._lock:
                for run in self._runs.values():  # in each pass: a thread may have started one just now
                    run.cancelled.set()
            for thread in self._threads:
                thread.join(CHECK_SECONDS / len(self._threads))
        self._stopped.set()
        self._monitor.join()
        try:
            self._jobs.queue.heartbeats.remove(self._lock_file.name)
        except QueueUnavailable as error:
            _log.warning("this consumer's heartbeat could not be removed: %s", error)

    def _run_jobs(self, index: int, threads: int) -> None:
        count = 0
        while not self._stopping.is_set():
            try:
                id_ = self._jobs.queue.pop(order_lanes(index, threads, count), POP_SECONDS)
                run = self._start_run(id_, holds_small=index == 0) if id_ is not None else None
                if run is not None:
                    count += 1
                    self._run_job(run)
            except QueueUnavailable:  # logged where it was raised
                self._stopping.wait(RETRY_SECONDS)
            except Exception:  # noqa: BLE001 - the thread must go on; `Recovery` runs the job again
                _log.exception("internal error before or after the run of a job")
                self._stopping.wait(RETRY_SECONDS)

    def _start_run(self, id_: str, *, holds_small: bool) -> _Run | None:
        with self._lock:
            self._leases += 1
            lease = create_lease(self._lock_file.name, self._leases)
        job = self._jobs.lifecycle.start(id_, lease)
        if job is None:  # it was cancelled, or was in the queue twice
            return None
        run = _Run(job, holds_small=holds_small and job.lane == "small")
        with self._lock:
            self._runs[lease] = run
        return run

    def _run_job(self, run: _Run) -> None:
        """Runs a job and stores the outcome. Lines of the log have the id of the request that submitted it."""
        token = REQUEST_ID.set(run.job.request_id)
        try:
            outcome = self._get_outcome(run)
            run.log_end(outcome)
            while not self._store_outcome(run, outcome):
                if self._stopping.wait(RETRY_SECONDS):
                    _log.warning("job %s: its outcome could not be stored; it will run again", run.job.id)
                    break
            if isinstance(outcome, Cancelled) and not run.cancelled.is_set():  # the pool is closed
                self._stopping.wait(RETRY_SECONDS)
        finally:
            REQUEST_ID.reset(token)
            with self._lock:
                del self._runs[run.job.lease]

    def _get_outcome(self, run: _Run) -> Result | Problem | Cancelled | WorkerDied:
        job = run.job
        try:
            with self._jobs.files.open_run(job.input, job.output, job.content) as files:
                task = Task(job.id, job.request, files.source, files.target, has_timed_out=job.has_timed_out)
                progress = partial(run.update_progress, self._jobs)
                outcome = self._pool.run(task, Hooks(run.begin, progress, run.cancelled))
                if isinstance(outcome, Result):
                    size, sha256 = files.publish()
                    outcome = replace(outcome, size=size, sha256=sha256)
                return outcome
        except (Cancelled, WorkerDied) as reason:
            return reason
        except QueueUnavailable as error:
            return Problem(503, find_response(error).title, str(error))
        except FileNotFoundError:
            _log.exception(
                "job %s: its input is missing or damaged; machines that share a queue must share CIIR_FILES", job.id
            )
            return Problem(503, "Not available", "the input is no longer stored as it was sent; post it again")
        except OSError as error:
            _log.error("job %s: its files can't be used (%s)", job.id, error.strerror, exc_info=not is_full(error))
            detail = f"the server's files can't be used ({error.strerror}); try again later"
            return NO_ROOM if is_full(error) else Problem(503, "Not available", detail)
        except Exception:  # noqa: BLE001 - logged, and the job fails
            _log.exception("job %s: internal error", job.id)
            return INTERNAL_ERROR

    def _store_outcome(self, run: _Run, outcome: Result | Problem | Cancelled | WorkerDied) -> bool:
        """Stores the outcome of a run. Returns False if the queue can't be reached."""
        job = run.job
        try:
            if isinstance(outcome, Result | Problem):
                if not self._jobs.lifecycle.finish(job, outcome):
                    _log.info("job %s: %s", job.id, LOST)
            elif isinstance(outcome, WorkerDied):
                timed_out = isinstance(outcome, TimedOut)
                self._jobs.lifecycle.retry_after_worker_death(job, timed_out=timed_out, cause=outcome.cause)
            else:  # changes nothing if the job was cancelled
                self._jobs.lifecycle.requeue(job, "large" if run.is_moved else job.lane)
        except QueueUnavailable:
            return False
        return True

    def _monitor_jobs(self) -> None:
        """Sends heartbeats, repairs and sweeps, stores progress and stops cancelled jobs, each at its own interval."""
        repaired = swept = float("-inf")
        is_clean = False
        while not self._stopped.wait(CHECK_SECONDS):
            now = time.monotonic()
            try:
                if now - repaired >= HEARTBEAT_SECONDS:
                    repaired = now
                    is_clean = self._recovery.send_heartbeat() and is_clean
                    with self._lock:
                        leases = set(self._runs)
                    self._recovery.repair(leases)
                    if not is_clean:
                        self._recovery.remove_leftovers()
                        is_clean = True
                self._check_runs()
                if now - swept >= SWEEP_SECONDS:
                    swept = now
                    if not self._jobs.sweep():
                        swept = float("-inf")  # sweep the rest after the next heartbeat
            except QueueUnavailable:
                continue
            except Exception:  # noqa: BLE001 - the thread must go on
                _log.exception("internal error while jobs were monitored")

    def _check_runs(self) -> None:
        with self._lock:
            runs = list(self._runs.values())
        jobs = self._jobs.records.get_many([run.job.id for run in runs])
        for run in runs:
            now = jobs.get(run.job.id)
            if now is None or now.lease != run.job.lease or now.state != "running":
                run.stop_without_lease()
            else:
                run.store_progress(self._jobs)
                if run.is_overstaying() and self._jobs.queue.count_waiting("small"):
                    run.is_moved = True
                    run.cancelled.set()


class _Run:
    """One run of a job and its progress."""

    def __init__(self, job: Job, *, holds_small: bool) -> None:
        """`holds_small`: whether the thread that must stay available for small jobs runs a small job."""
        self.job = job
        self.cancelled = threading.Event()
        """Stops the worker process."""
        self.is_moved = False
        """Whether it was stopped to be run in the large lane."""
        self._has_lease = True
        self._holds_small = holds_small
        self._begun: float | None = None
        self._fields: dict[str, Any] = {
            "job": job.id,
            "kind": job.request.kind,
            "lane": job.lane,
            "attempt": job.attempts,
        }
        self._lock = threading.Lock()
        self._newest: dict[str, Any] | None = None
        self._stored: dict[str, Any] | None = None
        self._started = self._stored_at = time.monotonic()

    def begin(self, pid: int) -> None:
        """Logs that the worker process `pid` has taken the task. The pool calls it."""
        self._begun = time.monotonic()
        self._fields["worker"] = pid
        options = json.dumps(self.job.request.options)[:200]  # printable, whatever the client sent
        text = "job %s: %s, run %d begins in worker process %d, %s lane: %s %s"
        job, asked = self.job, self.job.request
        values = (job.id, asked.kind, job.attempts, pid, job.lane, asked.name, options)
        _log.info(text, *values, extra={FIELDS: self._fields})

    def log_end(self, outcome: Result | Problem | Cancelled | WorkerDied) -> None:
        """Logs how the run ended, and after how many seconds in the worker process."""
        seconds = 0.0 if self._begun is None else round(time.monotonic() - self._begun, 3)
        level, status, text = logging.INFO, type(outcome).__name__, str(outcome)
        if isinstance(outcome, Result):
            status, text = "200", f"done, {outcome.size} bytes"
        elif isinstance(outcome, Problem):
            status, text = str(outcome.status), f"failed with {outcome.status} {outcome.title}: {outcome.detail}"
        elif isinstance(outcome, WorkerDied):
            level, text = logging.WARNING, f"the worker process {outcome}"
        elif self.is_moved:
            text = "moved to the large lane, because small jobs are waiting"
        else:
            text = f"stopped: {'the server stops' if self._has_lease else LOST}"
        fields = self._fields | {"seconds": seconds, "status": status}
        kind = self.job.request.kind
        _log.log(level, "job %s: %s, after %g s %s", self.job.id, kind, seconds, text, extra={FIELDS: fields})

    def stop_without_lease(self) -> None:
        """Stops the worker process, because the run has lost its lease."""
        self._has_lease = False
        self.cancelled.set()

    def is_overstaying(self) -> bool:
        """Checks whether it has occupied the thread for small jobs for over `SMALL_SECONDS`."""
        return self._holds_small and self._begun is not None and time.monotonic() - self._begun > SMALL_SECONDS

    def update_progress(self, jobs: Jobs, data: dict[str, Any]) -> None:
        """Stores the first progress, and keeps later progress for `store_progress`. The pool calls it."""
        self._newest = data
        if self._stored is None:
            self.store_progress(jobs)

    def store_progress(self, jobs: Jobs) -> None:
        """Adds the newest progress to the job's events if it is due; stops the run if its lease is lost."""
        with self._lock:
            data, now = self._newest, time.monotonic()
            interval = (now - self._started) / PROGRESS_EVENTS
            is_early = self._stored is not None and now - self._stored_at < interval
            if data is None or data == self._stored or is_early:
                return
            self._stored, self._stored_at = data, now
        try:
            if not jobs.lifecycle.add_progress(self.job, data):
                self.stop_without_lease()
        except QueueUnavailable as error:
            _log.warning("job %s: its progress was not stored: %s", self.job.id, error)
