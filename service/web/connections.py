"""Limits a server's open connections to the limit on open files, and closes idle ones for new ones."""

from __future__ import annotations

import errno
import logging
import resource
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import asyncio

    from ciir.service.settings import Settings

RESERVED_FILES = 128
"""Open files other than those of connections: of the queue in each thread, of listeners, logs and libraries."""
FILES_PER_WORKER = 4
FILES_PER_CONNECTION = 2
"""The socket, and an upload or a result."""
LOG_SECONDS = 1.0
_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_log = logging.getLogger("ciir")


def raise_file_limit() -> None:
    """Raises the soft limit on open files of this process to the hard limit."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def find_most(settings: Settings) -> int:
    """Returns the most connections: `max_connections`, or fewer if the limit on open files is low, which is logged."""
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    others = RESERVED_FILES + FILES_PER_WORKER * settings.workers
    allowed = max(1, (files - others) // FILES_PER_CONNECTION) if files != resource.RLIM_INFINITY else 2**31
    if allowed < settings.max_connections:
        _log.warning(
            "this process may have %d open files, which allows %d connections of CIIR_MAX_CONNECTIONS=%d; "
            "raise the hard limit (ulimit -Hn, --ulimit nofile=...)",
            files,
            allowed,
            settings.max_connections,
        )
    return min(settings.max_connections, allowed)


class AcceptErrors:
    """An event loop's exception handler that logs, at most once a second, that no connection could be accepted."""

    def __init__(self) -> None:
        self._logged = float("-inf")

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Handles an exception that no task has handled."""
        error = context.get("exception")
        if not (isinstance(error, OSError) and error.errno in _EXHAUSTED and "socket.accept" in context["message"]):
            loop.default_exception_handler(context)
        elif time.monotonic() - self._logged >= LOG_SECONDS:
            self._logged = time.monotonic()
            _log.error("no connection can be accepted (%s); lower CIIR_MAX_CONNECTIONS", error.strerror)
