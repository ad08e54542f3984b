"""How pictures for displays report what is done."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], object]
"""Called with the number of rows or views that are finished and of all."""


def ignore_progress(done: int, total: int) -> None:
    """Reports to nobody."""
