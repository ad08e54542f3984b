"""Prefetches items in a background thread."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Generator
    from concurrent.futures import Future

Item = TypeVar("Item")

READY = 1
"""Items that wait while the next one is made. More would take memory and gain no time."""


def prefetch(items: Generator[Item], *, name: str) -> Generator[Item]:
    """Yields `items` in order. A thread called `name` makes up to `READY + 1` of them before they are asked for.

    An error is raised in the place of its item. However this generator ends, `items` is closed and the thread ends.
    """
    with ThreadPoolExecutor(1, thread_name_prefix=name) as thread:
        coming: deque[Future[tuple[Item] | None]] = deque()
        try:
            while True:
                while len(coming) <= READY:
                    coming.append(thread.submit(_next_item, items))
                item = coming.popleft().result()
                if item is None:
                    return
                yield item[0]
        finally:
            for future in coming:
                future.cancel()
            thread.submit(items.close).result()


def _next_item(items: Generator[Item]) -> tuple[Item] | None:
    """Returns the next item in a tuple, or None after the last: a future can't carry `StopIteration`."""
    for item in items:
        return (item,)
    return None
