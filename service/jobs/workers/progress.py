"""The progress file, through which a worker process reports stages and finished views to its parent.

Each line is a JSON object, the data of a `progress` event.
"""

from __future__ import annotations

import json
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ciir.service.pipeline.report import Clock

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

VIEWS_SECONDS = 0.25
"""Least time between two lines for finished views."""


class ProgressClock(Clock):
    """A clock that appends a line when a stage first begins, and when views are finished."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._lock, self._stages = path, threading.Lock(), set[str]()
        self._data: dict[str, Any] = {"stage": "decode", "views_done": 0, "views": 0}
        self._written_at = float("-inf")

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """As `Clock.stage`."""
        with self._lock:
            if name not in self._stages:
                self._stages.add(name)
                self._data["stage"] = name
                self._write()
        with super().stage(name):
            yield

    def count_views(self, views_done: int, views: int) -> None:
        """Writes that `views_done` of `views` are finished, unless it is too soon after the last line."""
        with self._lock:
            self._data |= {"views_done": views_done, "views": views}
            if views_done == views or time.monotonic() - self._written_at >= VIEWS_SECONDS:
                self._write()

    def _write(self) -> None:
        self._written_at = time.monotonic()
        with self._path.open("ab", buffering=0) as file:
            file.write(json.dumps(self._data).encode() + b"\n")


def read_progress(path: Path, offset: int) -> tuple[list[dict[str, Any]], int]:
    """The complete lines of a progress file from byte `offset` on, and the offset after them."""
    try:
        with path.open("rb") as file:
            file.seek(offset)
            complete = file.read().rpartition(b"\n")[0]
    except FileNotFoundError:
        return [], offset
    return [json.loads(line) for line in complete.splitlines()], offset + (len(complete) + 1 if complete else 0)
