"""Waits for changes of jobs: one read serves everyone that waits for a job, and one query all jobs that are due."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from anyio import to_thread

from ciir.service.jobs.job import FINAL

if TYPE_CHECKING:
    from ciir.service.jobs.job import Job
    from ciir.service.jobs.queue import Queue
    from ciir.service.jobs.records import Records

AT_ONCE = 50
"""Waiting coroutines that are woken before other tasks of the event loop run."""


@dataclass
class _Watch:
    """A job that is waited for."""

    waiters: dict[asyncio.Future[Job | None], int] = field(default_factory=dict)
    """The waiting futures, with the number of events that each has seen."""
    due: float = 0.0
    """The time of the next read, on the event loop's clock."""
    pause: float = 0.0


class Watcher:
    """Reads a job's record when this process has changed it or the queue notifies, and also at growing intervals.

    Only coroutines of one event loop at a time may wait.
    """

    def __init__(self, records: Records, queue: Queue) -> None:
        self._records, self._queue = records, queue
        self._watches: dict[str, _Watch] = {}
        self._reader: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wake: asyncio.Event
        self._is_stopped = False
        records.subscribe(self._notify)

    async def wait_for_change(self, id_: str, seen: int) -> Job | None:
        """Returns the job as soon as it has ended or its number of events is not `seen`; None once `stop` was called.

        Raises `LookupError` if the job is removed, and `QueueUnavailable`.
        """
        self._loop = asyncio.get_running_loop()
        change: asyncio.Future[Job | None] = self._loop.create_future()
        if self._reader is None:
            self._wake = asyncio.Event()
            self._reader = self._loop.create_task(self._read())
        watch = self._watches.setdefault(id_, _Watch())
        watch.waiters[change] = seen
        self._set_due(id_)
        try:
            return await change
        finally:
            watch.waiters.pop(change, None)

    def stop(self) -> None:
        """Makes all waiting coroutines return, now and later. Call it in the thread of the event loop."""
        self._is_stopped = True
        for id_ in self._watches:
            self._set_due(id_)

    def _notify(self, id_: str) -> None:
        """Schedules the read of a changed job. Can be called from any thread."""
        if id_ in self._watches and self._loop is not None:
            with suppress(RuntimeError):  # the event loop is closed
                self._loop.call_soon_threadsafe(self._set_due, id_)

    def _set_due(self, id_: str) -> None:
        if (watch := self._watches.get(id_)) is not None:
            watch.due, watch.pause = 0.0, self._queue.poll_seconds[0]
            self._wake.set()

    async def _read(self) -> None:
        """Reads the jobs that are due, until nothing is waited for."""
        try:
            while self._watches:
                self._wake.clear()
                await self._read_due()
                self._watches = {id_: watch for id_, watch in self._watches.items() if watch.waiters}
                pause = min((watch.due for watch in self._watches.values()), default=0.0) - self._now()
                with suppress(TimeoutError):
                    async with asyncio.timeout(pause):
                        await self._wake.wait()
        finally:
            self._reader = None
            self._watches = {}

    async def _read_due(self) -> None:
        now = self._now()
        due = {id_: list(watch.waiters.items()) for id_, watch in self._watches.items() if watch.due <= now}
        if not due:
            return
        for watch in (self._watches[id_] for id_ in due):  # before the read, so that a change during it causes another
            watch.due, watch.pause = now + watch.pause, min(1.6 * watch.pause, self._queue.poll_seconds[1])
        is_stopped = self._is_stopped  # likewise: a job that ended before `stop` is returned, not None
        jobs: dict[str, Job] = {}
        error: Exception | None = None
        try:
            jobs = await to_thread.run_sync(self._get_many, list(due))
        except Exception as raised:  # noqa: BLE001 - raised in the waiting coroutines
            error = raised
        woken = 0
        for id_, waiters in due.items():
            job = jobs.get(id_)
            for change, seen in waiters:
                if change.done():
                    continue
                if error is not None or job is None:
                    change.set_exception(error or LookupError(id_))
                elif len(job.events) != seen or job.state in FINAL:
                    change.set_result(job)
                elif is_stopped:
                    change.set_result(None)
                else:
                    continue
                woken += 1
                if woken % AT_ONCE == 0:
                    await asyncio.sleep(0)

    def _get_many(self, ids: list[str]) -> dict[str, Job]:
        self._queue.listen(self._notify)
        return self._records.get_many(ids)

    def _now(self) -> float:
        assert self._loop is not None  # noqa: S101 - set before the reader starts
        return self._loop.time()
