"""Event streams of jobs: how many can be open, and what they send."""

from __future__ import annotations

import asyncio
import json
import logging
from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event
from starlette.exceptions import HTTPException

from ciir.errors import QueueUnavailable
from ciir.service.jobs.job import FINAL

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator

    from ciir.service.jobs.job import Job
    from ciir.service.jobs.watcher import Watcher

HEADERS = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}
"""Headers of a stream: neither a client nor a proxy may hold it back."""
RETRY_MILLISECONDS = 1000
"""Time after which a client reconnects to a broken stream."""
COMMENT_SECONDS = 15.0
"""Time without an event after which a comment is sent."""
RETRY_SECONDS = "5"
"""`Retry-After` of a refused stream."""
_log = logging.getLogger("ciir.jobs")


class OpenStreams:
    """The number of open streams, at most `most` in all and `most_of_client` for one client."""

    def __init__(self, most: int, most_of_client: int) -> None:
        self._most, self._most_of_client = most, most_of_client
        self._open = Counter[str]()

    @contextmanager
    def count(self, client: str) -> Iterator[None]:
        """Counts one more stream of `client`. Raises `HTTPException` 429 if it exceeds a limit."""
        if self._open[client] >= self._most_of_client:
            raise _refuse(f"{self._most_of_client} event streams of this client are open, as many as it may have")
        if self._open.total() >= self._most:
            raise _refuse(f"{self._most} event streams are open, as many as this server allows")
        self._open[client] += 1
        try:
            yield
        finally:
            self._open[client] -= 1
            self._open += Counter()  # drops clients without a stream


def _refuse(cause: str) -> HTTPException:
    detail = f"{cause}; close one, or ask for the job's status instead"
    return HTTPException(429, detail, {"Retry-After": RETRY_SECONDS})


async def stream_events(watcher: Watcher, job: Job, sent: int) -> AsyncIterator[bytes]:
    """Yields the events of `job` from number `sent` on, as they happen, until it has ended or the server stops."""
    yield format_sse_event(comment=f"job {job.id}", retry=RETRY_MILLISECONDS)
    while True:
        sent = sent if sent <= len(job.events) else 0  # the job was submitted again, and its events start again at 0
        if events := job.events[sent:]:
            yield b"".join(
                format_sse_event(event=event.kind, id=str(number), data_str=json.dumps(event.data))
                for number, event in enumerate(events, sent)
            )
        sent = len(job.events)
        if job.state in FINAL:
            return
        try:
            async with asyncio.timeout(COMMENT_SECONDS):
                later = await watcher.wait_for_change(job.id, sent)
        except TimeoutError:
            yield KEEPALIVE_COMMENT
            continue
        except (LookupError, QueueUnavailable) as error:  # the client gets the error when it reconnects
            _log.warning("job %s: its event stream ended: %s", job.id, error)
            return
        if later is None:
            return
        job = later
