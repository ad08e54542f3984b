"""The state that the routes of one server share."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from anyio import to_thread
from fastapi import Depends, Request

if TYPE_CHECKING:
    from ciir.service.jobs.engine import Engine
    from ciir.service.jobs.job import Job
    from ciir.service.metrics import Metrics
    from ciir.service.settings import Settings


@dataclass(frozen=True)
class ServiceState:
    """Settings, engine and metrics of one server."""

    settings: Settings
    engine: Engine
    metrics: Metrics
    stopped: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the server has drained: no job will run here any more."""

    async def wait_for_change(self, job: Job) -> Job | None:
        """Waits for the next event of `job` and returns the changed job, or None when the server has stopped.

        Raises `LookupError` if the job is gone, `QueueUnavailable` without the queue.
        """
        change = asyncio.ensure_future(self.engine.jobs.wait_for_change(job.id, len(job.events)))
        stop = asyncio.ensure_future(self.stopped.wait())
        try:
            await asyncio.wait((change, stop), return_when=asyncio.FIRST_COMPLETED)
            if change.done():
                return change.result()
            # The job may have ended just before the server stopped.
            last = await to_thread.run_sync(self.engine.jobs.get, job.id)
            return last if last is not None and len(last.events) != len(job.events) else None
        finally:
            change.cancel()
            stop.cancel()


def find_state(request: Request) -> ServiceState:
    """A dependency: the state of the server that got the request."""
    state: ServiceState = request.app.state.service
    return state


State = Annotated[ServiceState, Depends(find_state)]
