"""uvicorn's server with a drain before the shutdown: it answers requests while running jobs finish."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import threading
from typing import TYPE_CHECKING

import uvicorn

from ciir.service.web.connections import AcceptErrors, find_most
from ciir.service.web.middleware.protocol import make_protocol

if TYPE_CHECKING:
    import socket
    from types import FrameType

    from fastapi import FastAPI

    from ciir.service.web.routes.state import ServiceState

BACKLOG = 2048
"""Connections that the system keeps until they are accepted."""
ACCEPTED_AT_ONCE = 16
"""Connections that are accepted before the ones that they replace are closed."""
KEEP_ALIVE_SECONDS = 30
CLOSING_SECONDS = 6
"""Time after the drain for connections to end: more than `protocol.RESPONSE_SECONDS`."""
_log = logging.getLogger("ciir")


class DrainingServer(uvicorn.Server):
    """On the first signal the engine drains, while requests are answered and /readyz is 503. The exit status is then 0.

    A second signal kills the process.
    """

    def __init__(self, app: FastAPI) -> None:
        self._state: ServiceState = app.state.service
        super().__init__(
            uvicorn.Config(
                app,
                http=make_protocol(
                    self._state.settings.client_seconds, find_most(self._state.settings), self._state.engine.metrics
                ),
                backlog=ACCEPTED_AT_ONCE,
                ws="none",
                timeout_keep_alive=KEEP_ALIVE_SECONDS,
                timeout_graceful_shutdown=CLOSING_SECONDS,
                server_header=False,
                access_log=False,
                log_config=None,
            )
        )
        self._draining: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        """Serves until the drain has ended."""
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(AcceptErrors())
        await super().serve(sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts listening. asyncio uses `backlog` for both numbers, but only `ACCEPTED_AT_ONCE` should be small."""
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(BACKLOG)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:  # noqa: ARG002 - uvicorn's signature
        """Handles a signal, in the main thread."""
        if self._draining is None:
            self._state.engine.stop_accepting()
            self._draining = threading.Thread(target=self._drain, name="drain", daemon=True)
            self._draining.start()
        else:
            signal.signal(sig, signal.SIG_DFL)
            os.kill(os.getpid(), sig)  # worker processes end with this one, and the queue keeps all accepted jobs

    def _drain(self) -> None:
        _log.info("stopping: running jobs have %g s to finish", self._state.settings.drain_seconds)
        try:
            self._state.engine.drain()
        finally:
            assert self._loop is not None  # noqa: S101 - signals are handled within `serve`
            self._loop.call_soon_threadsafe(self._state.engine.jobs.watcher.stop)
            self.should_exit = True
