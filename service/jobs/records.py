"""What is known of each job, changed by one process or thread at a time and told to whoever waits for it here."""

from __future__ import annotations

import asyncio
import logging
from collections import defaultdict
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ciir.service.jobs.job import Job

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ciir.service.jobs.queue import Table

_log = logging.getLogger("ciir.jobs")


class Records:
    """Jobs by id in a table. Every method that reads or writes raises `QueueUnavailable`."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._listeners: defaultdict[str, list[Listener]] = defaultdict(list)

    def get(self, id_: str) -> Job | None:
        """The job as it stands."""
        return self._read(id_, self._table.get(id_))

    def many(self, ids: Sequence[str]) -> dict[str, Job]:
        """Those of the jobs that are there."""
        found = {id_: self._read(id_, text) for id_, text in self._table.many(ids).items()}
        return {id_: job for id_, job in found.items() if job is not None}

    def change(self, id_: str, step: Callable[[Job | None], Job | None]) -> Job | None:
        """Puts `step(job)` in the job's place, and returns it; `step` is called again where another was quicker.

        None where `step` returns None: nothing is changed then.
        """
        while True:
            before = self._table.get(id_)
            after = step(self._read(id_, before))
            if after is None:
                return None
            if self._table.swap(id_, before, after.to_bytes()):
                self._tell(after)
                return after

    def remove(self, id_: str, condition: Callable[[Job], bool]) -> Job | None:
        """Removes the job where it meets `condition`, and returns what it was; one that can't be read goes, too."""
        while True:
            before = self._table.get(id_)
            if before is None:
                return None
            job = self._read(id_, before)
            if job is not None and not condition(job):
                return None
            if self._table.swap(id_, before, None):
                return job

    @contextmanager
    def listening(self, id_: str) -> Iterator[Listener]:
        """Hears of every change to the job that is made through these records. To be used in an event loop."""
        listener = Listener()
        self._listeners[id_].append(listener)
        try:
            yield listener
        finally:
            others = [other for other in self._listeners[id_] if other is not listener]
            if others:
                self._listeners[id_] = others
            else:
                del self._listeners[id_]

    def _tell(self, job: Job) -> None:
        for listener in self._listeners.get(job.id, ()):
            listener.tell(job)

    def _read(self, id_: str, text: bytes | None) -> Job | None:
        if text is None:
            return None
        try:
            return Job.from_bytes(text)
        except (ValueError, LookupError, TypeError) as error:
            _log.warning("job %s: its record is another version's, or damaged (%s); it counts as not there", id_, error)
            return None


class Listener:
    """Waits in an event loop for what another thread tells."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._told = asyncio.Event()
        self._job: Job | None = None

    def tell(self, job: Job) -> None:
        """Called in any thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._take, job)

    def _take(self, job: Job) -> None:
        self._job = job
        self._told.set()

    async def heard(self, seconds: float) -> Job | None:
        """The newest of which was told since the last call; None where nothing was within `seconds`."""
        try:
            async with asyncio.timeout(seconds):
                await self._told.wait()
        except TimeoutError:
            return None
        self._told.clear()
        return self._job
