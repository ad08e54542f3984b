"""Ctrl-C and SIGTERM as requests to stop after the current step."""

from __future__ import annotations

import signal
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

    Handler = Callable[[int, FrameType | None], object] | int | None

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(Exception):  # noqa: N818 - no error: the run can go on
    """Raised when a run was stopped by a signal, after it has written a checkpoint."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.number = number
        """The signal's number."""


@contextmanager
def catch_signals() -> Iterator[list[int]]:
    """Appends the first signal within the block to a list and does nothing else. A second one acts as before the block.

    Like Python's signals, it works in the main thread only. Ignored signals stay ignored (`nohup`).
    """
    caught: list[int] = []
    before: dict[int, Handler] = {}

    def restore() -> None:
        while before:
            signal.signal(*before.popitem())

    def note(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature is Python's
        caught.append(number)
        restore()

    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, note)
    try:
        yield caught
    finally:
        restore()
