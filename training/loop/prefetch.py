"""Prefetches batches in threads, so that a GPU does not wait for them."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Generator
    from concurrent.futures import Future

    from torch import Tensor

    from ciir.training.loop.run import Inputs

    Batch = tuple[Inputs, Tensor]
    """The inputs of the network, and the truth."""


def prefetch_batches(
    at: Callable[[int], Batch], start: int, stop: int, *, threads: int, ready: int = 0
) -> Generator[Batch]:
    """Yields `at(start)`, `at(start + 1)`, ... up to `stop`, in order. `threads`: the number of threads that make them;
    with 0 the caller's thread does.

    `ready`: how many finished ones may wait. `at` must depend on its argument only.
    """
    if not threads:
        yield from map(at, range(start, stop))
        return
    pool = ThreadPoolExecutor(threads, thread_name_prefix="batches")
    coming: deque[Future[Batch]] = deque()
    try:
        for step in range(start, stop):
            coming.append(pool.submit(at, step))
            if len(coming) > max(threads, ready):
                yield coming.popleft().result()
        while coming:
            yield coming.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)  # a run that is stopped doesn't wait for batches that it no longer needs
