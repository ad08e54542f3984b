"""Stages that overlap: each makes what comes next while the one after it is at work."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Generator
    from concurrent.futures import Future

Item = TypeVar("Item")

READY = 1
"""Items that wait beside the one in the making: more hold memory and were no quicker."""


def ahead(items: Generator[Item], *, name: str) -> Generator[Item]:
    """`items` in order, made one after the other by a thread called `name`, `READY` of them before they are asked for.

    An error comes in its item's place. However this generator ends (exhausted, by an error, or closed early), the item
    in the making is waited for, no further one is begun, `items` is closed and the thread is gone.
    """
    with ThreadPoolExecutor(1, thread_name_prefix=name) as thread:
        coming: deque[Future[tuple[Item] | None]] = deque()
        try:
            while True:
                while len(coming) <= READY:
                    coming.append(thread.submit(_next, items))
                item = coming.popleft().result()
                if item is None:
                    return
                yield item[0]
        finally:
            for future in coming:
                future.cancel()
            thread.submit(items.close).result()


def _next(items: Generator[Item]) -> tuple[Item] | None:
    """The next item in a tuple of its own, None after the last: a future can't carry `StopIteration`."""
    for item in items:
        return (item,)
    return None
