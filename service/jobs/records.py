"""The records of all jobs, changed by compare and swap, with notifications within the process."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from ciir.service.jobs.job import Job

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ciir.service.jobs.queue import Table

_log = logging.getLogger("ciir.jobs")


class Records:
    """Jobs by id in a table. Every method that reads or writes raises `QueueUnavailable`."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._listeners: list[Callable[[str], object]] = []

    def get(self, id_: str) -> Job | None:
        """Returns the current record, or None."""
        return self._parse(id_, self._table.get(id_))

    def get_many(self, ids: Sequence[str]) -> dict[str, Job]:
        """Returns the records of those ids that have one."""
        found = {id_: self._parse(id_, text) for id_, text in self._table.get_many(ids).items()}
        return {id_: job for id_, job in found.items() if job is not None}

    def update(self, id_: str, step: Callable[[Job | None], Job | None]) -> Job | None:
        """Replaces the record by `step(record)` and returns it. Calls `step` again if the record has changed.

        Changes nothing and returns None if `step` returns None.
        """
        while True:
            before = self._table.get(id_)
            after = step(self._parse(id_, before))
            if after is None:
                return None
            synced = after.state != "running"  # an answer may promise it, and the end of a job removes its input
            if self._table.swap(id_, before, after.to_bytes(), synced=synced):
                for notify in self._listeners:
                    notify(id_)
                return after

    def remove(self, id_: str, condition: Callable[[Job], bool]) -> Job | None:
        """Removes the record if it meets `condition` or is unreadable, and returns it."""
        while True:
            before = self._table.get(id_)
            if before is None:
                return None
            job = self._parse(id_, before)
            if job is not None and not condition(job):
                return None
            if self._table.swap(id_, before, None, synced=True):
                return job

    def subscribe(self, notify: Callable[[str], object]) -> None:
        """Calls `notify` with the id of each job that is updated through this object, in the thread that updates it."""
        self._listeners.append(notify)

    def _parse(self, id_: str, text: bytes | None) -> Job | None:
        if text is None:
            return None
        try:
            return Job.from_bytes(text)
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            _log.warning("job %s: ignored its record, which is damaged or of another version (%s)", id_, error)
            return None
