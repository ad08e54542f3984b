"""Looks after what nobody works on any more: jobs whose consumer has died, and what a process that died left half done.

No clock on the wall decides anything: a consumer counts up while it lives, and one whose count has stood still for
`DEAD_SECONDS` of this process's own monotonic clock is dead. On the same machine the system tells at once (`owner`).
"""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING

from ciir.errors import QueueUnavailable
from ciir.service.jobs.job import FINAL

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from ciir.service.jobs.job import Job
    from ciir.service.jobs.jobs import Jobs
    from ciir.service.jobs.workers.consumer_lock import ConsumerLock

BEAT_SECONDS = 1.0
DEAD_SECONDS = 10.0
STRAY_SECONDS = 3.0
"""A job that waits and isn't in the queue, or runs here and isn't worked on, for so long was lost on the way: whoever
moved it died between two steps, or the queue's answer got lost."""
STALE_SECONDS = 600.0
"""An input that belongs to no job for so long is that of a process that died while it took it in."""
_log = logging.getLogger("ciir.jobs")


class Watch:
    """What one consumer sees of all jobs that wait or run. Every method raises `QueueUnavailable`."""

    def __init__(self, jobs: Jobs, owner: ConsumerLock, clock: Callable[[], float] = time.monotonic) -> None:
        self._jobs, self._owner, self._clock = jobs, owner, clock
        self._count = 0
        self._beats: dict[str, tuple[bytes, float]] = {}
        """Consumer -> its count, and since when it has stood there."""
        self._troubles: dict[tuple[str, str], float] = {}
        """A job's input, and what is wrong with it -> since when."""

    def beat(self) -> None:
        """Says that this consumer lives."""
        self._count += 1
        try:
            self._jobs.queue.beats.put(self._owner.name, str(self._count).encode())
        except QueueUnavailable:  # nor can the others say it: their silence up to now doesn't count
            self._beats, self._troubles = {}, {}
            raise

    def look(self, claims: Collection[str]) -> None:
        """Puts right what it finds; `claims`: those that this consumer works on."""
        now = self._clock()
        beats = self._jobs.queue.beats.items()
        self._beats = {name: self._stood(name, count, now) for name, count in beats.items()}
        names = list(self._jobs.queue.active.items())
        jobs = self._jobs.records.many([_id(name) for name in names])
        waiting = self._jobs.queue.contents() if names else set()
        before, self._troubles = self._troubles, {}
        for name in names:
            job = jobs.get(_id(name))
            trouble, seconds = self._trouble(name, job, waiting, claims, now)
            if trouble:
                since = self._troubles[name, trouble] = before.get((name, trouble), now)
                if now - since >= seconds:
                    self._mend(name, job)
        for name in beats:
            if self._is_dead(name, now):
                self._jobs.queue.beats.remove(name)

    def tidy(self) -> None:
        """Removes what consumers of this machine that have ended left behind, after `look` has put their jobs back; and
        files that no job knows of, as where a queue was emptied.
        """
        gone = [name for name in self._owner.names() if self._owner.is_gone(name)]
        for made in self._jobs.files.runs():
            if owner_of(made.rpartition(".")[2]) in gone:
                self._jobs.files.discard_run(made)
        for name in gone:
            self._owner.forget(name)
        self._jobs.forget_unknown()

    def _trouble(
        self, name: str, job: Job | None, waiting: Collection[str], claims: Collection[str], now: float
    ) -> tuple[str, float]:
        """What is wrong with what the input `name` belongs to, and for how long it may be; empty for nothing."""
        if job is None or job.input != name:
            return "stale", STALE_SECONDS
        if job.state in FINAL:
            return "unsettled", 0.0
        if job.state == "queued":
            return ("", 0.0) if job.id in waiting else ("stray", STRAY_SECONDS)
        owner = owner_of(job.claim)
        if owner == self._owner.name:
            return ("", 0.0) if job.claim in claims else ("dropped", STRAY_SECONDS)
        if self._is_dead(owner, now):
            return "orphaned", 0.0
        return ("", 0.0) if owner in self._beats else ("silent", DEAD_SECONDS)

    def _mend(self, name: str, job: Job | None) -> None:
        if job is None or job.input != name:
            self._jobs.forget_input(name)
        elif job.state in FINAL:
            self._jobs.lifecycle.settle(job)
        elif job.state == "queued":
            _log.warning("job %s: waited outside the queue; it is put back", job.id)
            self._jobs.queue.push(job.lane, job.id)
        else:
            self._jobs.lifecycle.consumer_died(job)

    def _stood(self, name: str, count: bytes, now: float) -> tuple[bytes, float]:
        held = self._beats.get(name)
        return held if held is not None and held[0] == count else (count, now)

    def _is_dead(self, name: str, now: float) -> bool:
        if name == self._owner.name:
            return False
        return self._owner.is_gone(name) or (name in self._beats and now - self._beats[name][1] >= DEAD_SECONDS)


def claim_of(owner: str, number: int) -> str:
    """The claim of a consumer's run."""
    return f"{owner}-{number}"


def owner_of(claim: str) -> str:
    """The consumer that made it."""
    return claim.partition("-")[0]


def _id(name: str) -> str:
    return name.partition(".")[0]
