"""Finds jobs whose consumer died, or that a dying process left between two steps, and repairs them.

A consumer on the same machine is dead when its lock is free (`consumer_lock`). Any other consumer is dead when its
heartbeat, which is a count, has not changed for `DEAD_SECONDS` on this process's monotonic clock.
"""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING

from ciir.errors import QueueUnavailable
from ciir.service.jobs.job import FINAL, parse_id
from ciir.service.jobs.workers.orphans import remove_orphaned_files
from ciir.service.jobs.workers.restore import restore_jobs

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from ciir.service.jobs.job import Job
    from ciir.service.jobs.jobs import Jobs
    from ciir.service.jobs.workers.consumer_lock import ConsumerLock

HEARTBEAT_SECONDS = 1.0
DEAD_SECONDS = 10.0
LOST_SECONDS = 3.0
"""A job is lost after this long outside the queue in state `queued`, or in state `running` with a lease of this
consumer that no thread holds: a process died between two steps, or the queue's answer was lost."""
STALE_SECONDS = 600.0
"""An input without a job is removed after this long: the process that received it died."""
Heartbeats = dict[str, tuple[bytes, float]]
"""Consumer -> its count, and when this process first read that count."""
_log = logging.getLogger("ciir.jobs")


class Recovery:
    """Repairs all jobs that are not settled; one consumer does this. Every method raises `QueueUnavailable`."""

    def __init__(self, jobs: Jobs, lock: ConsumerLock, clock: Callable[[], float] = time.monotonic) -> None:
        self._jobs, self._lock, self._clock = jobs, lock, clock
        self._count = 0
        self._heartbeats: Heartbeats = {}
        self._defects: dict[tuple[str, str], float] = {}
        """A job's input and its defect -> when this process first saw it."""

    def send_heartbeat(self) -> bool:
        """Raises this consumer's count. Returns whether the queue still has the last one, and so its other data."""
        table, name = self._jobs.queue.heartbeats, self._lock.name
        self._count += 1
        try:
            is_known = table.get(name) is not None
            table.put(name, str(self._count).encode())
        except QueueUnavailable:  # other consumers can't send theirs either, so the time until now doesn't count
            self._heartbeats, self._defects = {}, {}
            raise
        return is_known

    def repair(self, leases: Collection[str]) -> None:
        """Repairs every defect that has lasted long enough. `leases` are those that this consumer's threads hold."""
        now = self._clock()
        heartbeats = self._jobs.queue.heartbeats.items()
        self._heartbeats = date_heartbeats(heartbeats, self._heartbeats, now)
        names = list(self._jobs.queue.active.items())
        jobs = self._jobs.records.get_many([parse_id(name) for name in names])
        waiting = self._jobs.queue.list_waiting() if names else set()
        before, self._defects = self._defects, {}
        for name in names:
            job = jobs.get(parse_id(name))
            defect, seconds = self._find_defect(name, job, waiting, leases, now)
            if defect:
                since = self._defects[name, defect] = before.get((name, defect), now)
                if now - since >= seconds:
                    self._repair(name, job)
        for name in heartbeats:
            if self._is_dead(name, now):
                self._jobs.queue.heartbeats.remove(name)

    def remove_leftovers(self) -> None:
        """Removes the files of dead consumers on this machine, restores jobs without a record, and removes old files.

        Call it after `repair`.
        """
        dead = [name for name in self._lock.list_names() if self._lock.is_dead(name)]
        for result in self._jobs.files.list_runs():
            if parse_consumer(result.rpartition(".")[2]) in dead:
                self._jobs.files.remove_run(result)
        for name in dead:
            self._lock.remove(name)
        restore_jobs(self._jobs)
        remove_orphaned_files(self._jobs)

    def _find_defect(
        self, name: str, job: Job | None, waiting: Collection[str], leases: Collection[str], now: float
    ) -> tuple[str, float]:
        """Returns the defect of the job of input `name`, and after how many seconds to repair it; empty for none."""
        if job is None or job.input != name:
            return "input without a job", STALE_SECONDS
        if job.state in FINAL:
            return "not settled", 0.0
        if job.state == "queued":
            return ("", 0.0) if job.id in waiting else ("not in the queue", LOST_SECONDS)
        consumer = parse_consumer(job.lease)
        if consumer == self._lock.name:
            return ("", 0.0) if job.lease in leases else ("not held by a thread", LOST_SECONDS)
        if self._is_dead(consumer, now):
            return "consumer is dead", 0.0
        return ("", 0.0) if consumer in self._heartbeats else ("consumer sent no heartbeat", DEAD_SECONDS)

    def _repair(self, name: str, job: Job | None) -> None:
        if job is None or job.input != name:
            self._jobs.remove_input(name)
        elif job.state in FINAL:
            self._jobs.lifecycle.settle(job)
        elif job.state == "queued":
            _log.warning("job %s: was not in the queue; queued again", job.id)
            self._jobs.queue.push(job.lane, job.id)
        else:
            self._jobs.lifecycle.retry_after_consumer_death(job)

    def _is_dead(self, name: str, now: float) -> bool:
        if name == self._lock.name:
            return False
        has_stopped = name in self._heartbeats and now - self._heartbeats[name][1] >= DEAD_SECONDS
        return has_stopped or self._lock.is_dead(name)


def date_heartbeats(counts: Mapping[str, bytes], before: Heartbeats, now: float) -> Heartbeats:
    """Returns the consumers of `counts`, which was read at `now`; `before`: what the last call returned."""
    known = {name: (count, since) for name, (count, since) in before.items() if counts.get(name) == count}
    return {name: (count, now) for name, count in counts.items()} | known


def create_lease(consumer: str, number: int) -> str:
    """Creates the lease of a consumer's run."""
    return f"{consumer}-{number}"


def parse_consumer(lease: str) -> str:
    """Returns the consumer that created a lease."""
    return lease.partition("-")[0]
