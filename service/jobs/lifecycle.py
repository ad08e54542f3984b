"""What happens to a job from its first run to its end: each step holds only while the run's claim does."""

from __future__ import annotations

import json
import logging
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ciir.service.jobs.files import INPUTS, RESULTS
from ciir.service.jobs.job import FINAL, Event, Job, Problem, Result

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.service.jobs.files import Files
    from ciir.service.jobs.queue import Queue
    from ciir.service.jobs.records import Records

MOST_DEATHS = 2
"""Worker processes that may die of one job."""
MOST_ATTEMPTS = 5
"""Runs that may be begun and never end because whoever ran them died: a job that takes the machine down isn't run for
ever."""
KILLER = Problem(
    422, "Worker stopped", "the input stopped the worker process twice; send a smaller one, or report it as a fault"
)
INTERRUPTED = Problem(
    503, "Interrupted", f"the server was stopped in each of {MOST_ATTEMPTS} runs; ask again to have it run again"
)
_log = logging.getLogger("ciir.jobs")


class Lifecycle:
    """The steps. All raise `QueueUnavailable`; all but `settle` change nothing where the claim is no longer the
    job's."""

    def __init__(self, queue: Queue, records: Records, files: Files) -> None:
        self._queue, self._records, self._files = queue, records, files

    def begin(self, id_: str, claim: str) -> Job | None:
        """Claims a job that waits; None where it doesn't, any more."""

        def step(job: Job | None) -> Job | None:
            if job is None or job.state != "queued":
                return None
            attempts = job.attempts + 1
            return job.after(Event("running", {"attempt": attempts}), state="running", attempts=attempts, claim=claim)

        return self._records.change(id_, step)

    def progress(self, run: Job, data: dict[str, Any]) -> bool:
        """Adds an event; False where the run isn't the job's any more: it was cancelled, or taken for dead."""
        return self._change(run, lambda job: job.after(Event("progress", data))) is not None

    def finish(self, run: Job, outcome: Result | Problem) -> bool:
        """The end of a run whose result, if it has one, is in its place. False, and that is gone, where the run isn't
        the job's any more."""

        def step(job: Job) -> Job:
            if isinstance(outcome, Problem):
                return job.after(Event("failed", asdict(outcome)), state="failed", problem=outcome)
            told = {"format": outcome.format, "size": outcome.size}
            return job.after(Event("done", told), state="done", result=outcome)

        done = self._change(run, step)
        if done is not None:
            self.settle(done)
            return True
        now = self._records.get(run.id)
        if now is not None and now.state in FINAL and now.claim == run.claim and (now.result or now.problem) == outcome:
            self.settle(now)  # it was written the last time this was tried, and the answer was lost
            return True
        self._files.remove(RESULTS, run.output)
        return False

    def again(self, run: Job) -> None:
        """Puts a run that was stopped back into the queue, from the start."""
        self._requeue(run, lambda job: job.after(Event("queued"), state="queued"))

    def worker_died(self, run: Job) -> None:
        """Runs the job again, or fails it where its worker has died `MOST_DEATHS` times."""

        def step(job: Job) -> Job:
            deaths = job.deaths + 1
            if deaths >= MOST_DEATHS:
                return job.after(Event("failed", asdict(KILLER)), state="failed", problem=KILLER, deaths=deaths)
            return job.after(Event("queued"), state="queued", deaths=deaths)

        self._requeue(run, step)

    def consumer_died(self, run: Job) -> None:
        """Runs the job again, or fails it after `MOST_ATTEMPTS`; what the run has left is removed."""

        def step(job: Job) -> Job:
            if job.attempts >= MOST_ATTEMPTS:
                return job.after(Event("failed", asdict(INTERRUPTED)), state="failed", problem=INTERRUPTED)
            return job.after(Event("queued"), state="queued")

        if self._requeue(run, step):
            self._files.discard(run.output)

    def cancel(self, id_: str) -> Job | None:
        """The job, cancelled if it waited or ran; None where it isn't there."""

        def step(job: Job | None) -> Job | None:
            if job is None or job.state in FINAL:
                return None
            return job.after(Event("cancelled"), state="cancelled")

        cancelled = self._records.change(id_, step)
        if cancelled is None:
            return self._records.get(id_)
        self.settle(cancelled)
        return cancelled

    def settle(self, job: Job) -> None:
        """What follows from a job's end: its result is kept for a while, its input isn't.

        May be done twice; `service.jobs.workers.recovery` does it again where it wasn't done to the end.
        """
        self.touch(job)
        self._files.remove(INPUTS, job.input)
        self._queue.active.remove(job.input)

    def touch(self, job: Job) -> None:
        """Notes that a finished job was asked for just now."""
        self.keep(job.input, len(job.to_bytes()) + (job.result.size if job.result is not None else 0))

    def keep(self, name: str, size: int) -> None:
        """Notes that the finished job whose input had `name`, of so many bytes with its result, is used now."""
        self._queue.kept.put(name, json.dumps([time.time(), size]).encode())

    def _change(self, run: Job, step: Callable[[Job], Job]) -> Job | None:
        def guarded(job: Job | None) -> Job | None:
            is_ours = job is not None and job.state == "running" and job.claim == run.claim
            return step(job) if job is not None and is_ours else None

        return self._records.change(run.id, guarded)

    def _requeue(self, run: Job, step: Callable[[Job], Job]) -> bool:
        job = self._change(run, step)
        if job is None:
            return False
        if job.state in FINAL:
            self.settle(job)
        else:
            _log.warning("job %s: run %d was stopped; it is run again", job.id, job.attempts)
            self._queue.push(job.lane, job.id)
        return True
