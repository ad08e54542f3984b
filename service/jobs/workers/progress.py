"""The progress of a task: its stage and its finished views."""

from __future__ import annotations

import math
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ciir.service.pipeline.report import STAGES, Clock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

VIEWS_SECONDS = 0.25
"""The least time between two reports of finished views."""


class ProgressClock(Clock):
    """A clock that reports when the earliest stage at work changes, and when views are finished.

    Stages overlap. The earliest one at work is the one that the others wait for.
    """

    def __init__(self, report: Callable[[dict[str, Any]], None]) -> None:
        """`report` is called with the data of each progress event, from any thread, one at a time."""
        super().__init__()
        self._report, self._reporting = report, threading.Lock()
        self._threads = dict.fromkeys(STAGES, 0)  # at work in each stage
        self._data: dict[str, Any] = {"stage": STAGES[0], "views_done": 0, "views": 0}
        self._sent_at = -math.inf

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of the block, as `Clock.stage` does, and reports the stage."""
        self._count_threads(name, 1)
        try:
            with super().stage(name):
                yield
        finally:
            self._count_threads(name, -1)

    def count_views(self, views_done: int, views: int) -> None:
        """Reports that `views_done` of `views` are finished, unless it is too soon after the last report."""
        with self._reporting:
            self._data |= {"views_done": views_done, "views": views}
            if views_done == views or time.monotonic() - self._sent_at >= VIEWS_SECONDS:
                self._send()

    def _count_threads(self, name: str, change: int) -> None:
        with self._reporting:
            self._threads[name] += change
            earliest = next((stage for stage in STAGES if self._threads[stage]), self._data["stage"])
            if earliest != self._data["stage"] or math.isinf(self._sent_at):
                self._data["stage"] = earliest
                self._send()

    def _send(self) -> None:
        self._sent_at = time.monotonic()
        self._report(dict(self._data))
