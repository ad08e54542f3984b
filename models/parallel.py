"""Runs independent calls in parallel, each in its own thread, as many at once as there are cores."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Item = TypeVar("Item")

CALLS_PER_CORE = 2
"""Fewest calls per core for which calls run in parallel. With fewer, cores would idle during the last calls, and it is
faster to run one call after the other on all cores."""


def is_parallel_faster(calls: int, cores: int) -> bool:
    """Returns whether `calls` calls are faster in parallel, each on one of `cores`, than one by one on all of them."""
    return cores > 1 and calls >= CALLS_PER_CORE * cores


def run_each(work: Callable[[Item], object], items: Sequence[Item], cores: int) -> None:
    """Calls `work` with each of `items`, up to `cores` at once; with one core in the caller's thread, in order.

    Raises the first error in the order of `items`, after all threads have ended. Items that had not started by then
    are skipped.
    """
    if cores == 1:
        for item in items:
            work(item)
        return
    with ThreadPoolExecutor(cores, thread_name_prefix="parallel") as pool:
        futures = [pool.submit(work, item) for item in items]
        try:
            for future in futures:
                future.result()
        finally:
            for future in futures:
                future.cancel()
