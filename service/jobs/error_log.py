"""Trouble with what is used all the time, in the log: once when it begins and once when it is over."""

from __future__ import annotations

import logging

_log = logging.getLogger("ciir.jobs")


class Trouble:
    """What is wrong with one thing just now. Threads may share it."""

    def __init__(self, what: str) -> None:
        self._what, self._why = what, ""

    def begins(self, why: str) -> None:
        """It failed; logged unless it failed in the same way the last time."""
        if why != self._why:
            self._why = why
            _log.warning("%s: %s", self._what, why)

    def is_over(self) -> None:
        """It worked."""
        if self._why:
            self._why = ""
            _log.warning("%s can be used again", self._what)
