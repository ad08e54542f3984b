"""Logs the errors of a resource in constant use: once when they begin and once when they are over."""

from __future__ import annotations

import logging

_log = logging.getLogger("ciir.jobs")


class ErrorLog:
    """The log of one resource. Threads may share it."""

    def __init__(self, resource: str) -> None:
        self._resource, self._reason = resource, ""

    def log_error(self, reason: str) -> None:
        """Logs that an operation failed, unless the last one failed for the same reason."""
        if reason != self._reason:
            self._reason = reason
            _log.warning("%s: %s", self._resource, reason)

    def log_success(self) -> None:
        """Logs that the resource works again, if the last operation failed."""
        if self._reason:
            self._reason = ""
            _log.warning("%s can be used again", self._resource)
