"""What the routes share."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ciir.service.jobs.engine import Engine
    from ciir.service.jobs.job import Job
    from ciir.service.metrics import Metrics
    from ciir.service.settings import Settings


@dataclass(frozen=True)
class ServiceState:
    """One server's."""

    settings: Settings
    engine: Engine
    metrics: Metrics
    stopped: asyncio.Event = field(default_factory=asyncio.Event)
    """Set once the server is drained: nobody need wait for a job that nobody here will do."""

    async def wait_for_change(self, job: Job) -> Job | None:
        """`job` once more has happened to it; None where the server stopped before.

        Raises `LookupError` where it is gone, `QueueUnavailable` where the queue is.
        """
        change = asyncio.ensure_future(self.engine.jobs.wait_for_change(job.id, len(job.events)))
        stop = asyncio.ensure_future(self.stopped.wait())
        try:
            await asyncio.wait((change, stop), return_when=asyncio.FIRST_COMPLETED)
            return change.result() if change.done() else None
        finally:
            change.add_done_callback(_forget)
            change.cancel()
            stop.cancel()


def _forget(change: asyncio.Task[Job]) -> None:
    """Takes note of how it ended, where nobody waits for it any more; asyncio would complain that nobody did."""
    if not change.cancelled():
        change.exception()
