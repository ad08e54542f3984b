"""Reports progress, also of the parts of a picture that several threads work on."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from ciir.cores import count_available_cores

Item = TypeVar("Item")
Progress = Callable[[int, int], object]
"""Called with the number of rows or views that are finished and the total number."""

MOST_THREADS = 4
"""Most threads; each holds tens of megabytes."""


def ignore_progress(done: int, total: int) -> None:
    """Reports nothing."""


@contextmanager
def report_one(progress: Progress) -> Iterator[None]:
    """Reports a block that can't be divided: none of one, then one of one."""
    progress(0, 1)
    yield
    progress(1, 1)


def report_made(items: Iterator[Item], total: int, progress: Progress) -> Iterator[Item]:
    """Yields `items`, of which there are `total`, and reports each as soon as it is made."""
    for done, item in enumerate(items, 1):
        progress(done, total)
        yield item


def report_finished(items: Collection[Item], progress: Progress) -> Iterator[Item]:
    """Yields `items`, and reports each when a loop over them has finished with it."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, len(items))


def run_parts(make: Callable[[int], object], count: int, progress: Progress = ignore_progress) -> None:
    """Calls `make` with 0 to `count - 1`, in several threads: numpy's work runs in parallel.

    `progress` is called in the caller's thread. Raises what `make` raises.
    """
    with ThreadPoolExecutor(min(MOST_THREADS, count_available_cores())) as pool:
        for done, _ in enumerate(pool.map(make, range(count)), 1):
            progress(done, count)
