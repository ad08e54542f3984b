"""A resource whose errors become `QueueUnavailable`, logged once when they begin and once when they are over."""

from __future__ import annotations

import errno
import logging
import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ciir.errors import NoRoom, QueueUnavailable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PROGRAMMING_ERRORS = (AssertionError, AttributeError, NameError, TypeError)
"""Errors that no client of an object store raises when its store fails, although each client has its own errors."""
DISK_FULL = "the server's disk is full; try again later, or have its operator free disk space"
FULL_AT_START = "the disk is full; free disk space there, or name another folder"
_log = logging.getLogger("ciir.jobs")


def is_full(error: Exception) -> bool:
    """Checks whether the error is that of a full disk or quota, also from SQLite."""
    if isinstance(error, sqlite3.Error):
        return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)


class Resource:
    """The queue, or the files. Threads can share it."""

    def __init__(self, name: str, describe: Callable[[Exception], str | None]) -> None:
        """`describe` returns the message for clients if an exception is an error of this resource, else None."""
        self._name, self._describe = name, describe
        self._error = ""

    def has_failed(self) -> bool:
        """Checks whether the last use failed."""
        return self._error != ""

    @contextmanager
    def use(self) -> Iterator[None]:
        """Raises `QueueUnavailable` for an error of the resource, which is logged unless the last one was the same.

        For a full disk that is a `NoRoom`.
        """
        try:
            yield
        except Exception as error:
            message = self._describe(error)
            if message is None:
                raise
            if str(error) != self._error:
                self._error = str(error)
                _log.warning("%s: %s", self._name, error)
            raise (NoRoom if is_full(error) else QueueUnavailable)(message) from error
        if self._error:
            self._error = ""
            _log.warning("%s can be used again", self._name)
