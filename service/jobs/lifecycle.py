"""The changes of state of a job, from its first run to its end.

A run can change the job only while it holds the lease.
"""

from __future__ import annotations

import json
import logging
import time
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from ciir.service.jobs.files import INPUTS, RECORD, RESULTS
from ciir.service.jobs.job import FINAL, Event, Job, Problem, Result

if TYPE_CHECKING:
    from ciir.service.jobs.files import Files
    from ciir.service.jobs.job import Lane
    from ciir.service.jobs.queue import Queue
    from ciir.service.jobs.records import Records

WORKER_DEATH_LIMIT = 2
"""A job fails when this many worker processes have died during its runs."""
ATTEMPT_LIMIT = 5
"""A job fails when its consumer died in this many runs, so that a job that crashes the machine does not run for
ever."""
_UNKNOWN = "because the server lacked memory or time, or the input crashed it"
INTERRUPTED = Problem(
    503, "Interrupted", f"the server was stopped in each of {ATTEMPT_LIMIT} runs; submit again to retry"
)
_log = logging.getLogger("ciir.jobs")


class Lifecycle:
    """Changes of state. All raise `QueueUnavailable`. Those that take a run change nothing if its lease is lost."""

    def __init__(self, queue: Queue, records: Records, files: Files, installation: str) -> None:
        """`installation` is that of this process, from `identity.hash_installation`."""
        self._queue, self._records, self._files, self._installation = queue, records, files, installation

    def start(self, id_: str, lease: str) -> Job | None:
        """Leases a queued job and returns the run, or None if the job is not queued."""

        def step(job: Job | None) -> Job | None:
            if job is None or job.state != "queued":
                return None
            attempts = job.attempts + 1
            event = Event("running", {"attempt": attempts})
            return job.add_event(event, state="running", attempts=attempts, lease=lease, started=time.time())

        return self._records.update(id_, step)

    def add_progress(self, run: Job, data: dict[str, Any]) -> bool:
        """Adds a progress event.

        Returns False if the lease is lost: the job was cancelled, or its consumer declared dead.
        """
        return self._update(run, Event("progress", data)) is not None

    def finish(self, run: Job, outcome: Result | Problem) -> bool:
        """Ends the job. If the lease is lost, removes the run's result file and returns False."""
        maker = self._installation
        if isinstance(outcome, Problem):
            done = self._update(run, Event("failed", asdict(outcome)), problem=outcome, made_by=maker)
        else:
            event = Event("done", {"format": outcome.format, "size": outcome.size})
            done = self._update(run, event, result=outcome, made_by=maker)
        if done is None:
            now = self._records.get(run.id)
            if now is not None and now.lease == run.lease and (now.result or now.problem) == outcome:
                done = now  # an earlier call stored it, but the queue's answer was lost
        if done is None:
            self._files.remove(RESULTS, run.output)
            return False
        self.settle(done)
        return True

    def requeue(self, run: Job, lane: Lane) -> None:
        """Puts the job of a run that was stopped back into the queue, in `lane`."""
        self._retry(run, None, logging.DEBUG, lane=lane)  # nothing failed; the consumer logs why the run ended

    def retry_after_worker_death(self, run: Job, *, timed_out: bool, cause: str = "") -> None:
        """Queues the job again, or fails it after `WORKER_DEATH_LIMIT`.

        `timed_out`: whether a time-out ended the worker. `cause`: that of `WorkerDied`.
        """
        deaths = run.worker_deaths + 1
        problem = describe_deaths(cause) if deaths >= WORKER_DEATH_LIMIT else None
        self._retry(run, problem, worker_deaths=deaths, has_timed_out=timed_out)

    def retry_after_consumer_death(self, run: Job) -> None:
        """Queues the job again, or fails it after `ATTEMPT_LIMIT`, and removes the run's files."""
        if self._retry(run, INTERRUPTED if run.attempts >= ATTEMPT_LIMIT else None):
            self._files.remove_run(run.output)
            self._files.remove(RESULTS, run.output)

    def cancel(self, id_: str, client: str = "") -> Job | None:
        """Removes the client from the job, and cancels the job if it has no other clients and hasn't ended.

        Returns the job, or None if there is no such job.
        """

        def step(job: Job | None) -> Job | None:
            if job is None:
                return None
            if others := job.list_others(client):
                return replace(job, clients=others)
            return None if job.state in FINAL else job.add_event(Event("cancelled"), state="cancelled", clients=())

        job = self._records.update(id_, step)
        if job is None:
            return self._records.get(id_)
        if job.state == "cancelled":
            self.settle(job)
        return job

    def settle(self, job: Job) -> None:
        """Registers an ended job for expiry and removes its input.

        It can be repeated: `service.jobs.workers.recovery` does so if a process died before it was complete.
        """
        self.mark_used(job)
        self._files.remove(INPUTS, job.input, job.input + RECORD)
        self._queue.active.remove(job.input)

    def mark_used(self, job: Job) -> None:
        """Stores that an ended job was used just now."""
        self.store_use(job.input, len(job.to_bytes()) + (job.result.size if job.result is not None else 0))

    def store_use(self, name: str, size: int) -> None:
        """Stores that the ended job with the input `name`, of `size` bytes with its result, was used just now."""
        self._queue.finished.put(name, json.dumps([time.time(), size]).encode())

    def _update(self, run: Job, event: Event, **changes: Any) -> Job | None:
        """Adds an event, whose kind is the new state unless it is progress. Returns None if the lease is lost."""
        state = "running" if event.kind == "progress" else event.kind

        def step(job: Job | None) -> Job | None:
            has_lease = job is not None and job.state == "running" and job.lease == run.lease
            return job.add_event(event, state=state, **changes) if job is not None and has_lease else None

        return self._records.update(run.id, step)

    def _retry(self, run: Job, problem: Problem | None, level: int = logging.WARNING, **changes: Any) -> bool:
        """Queues the job again, or fails it with `problem`. Returns False if the lease is lost."""
        event = Event("queued") if problem is None else Event("failed", asdict(problem))
        job = self._update(run, event, problem=problem, **changes)
        if job is None:
            return False
        if problem is not None:
            self.settle(job)
        else:
            _log.log(level, "job %s: run %d was stopped; queued again", job.id, job.attempts)
            self._queue.push(job.lane, job.id)
        return True


def describe_deaths(cause: str) -> Problem:
    """Returns the problem of a job after `WORKER_DEATH_LIMIT`; `cause` is that of the last death, empty if unknown."""
    why = f"in the last one because {cause}" if cause else _UNKNOWN
    detail = f"the worker process was stopped in {WORKER_DEATH_LIMIT} runs, {why}"
    return Problem(503, "Worker stopped", f"{detail}; submit again later, or send a smaller input")
