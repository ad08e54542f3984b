"""Works on the parts of a picture in several threads and reports progress."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from ciir.cores import count_available_cores

Progress = Callable[[int, int], object]
"""Called with the number of rows or views that are finished and the total number."""

MOST_THREADS = 4
"""Most threads; each holds tens of megabytes."""


def ignore_progress(done: int, total: int) -> None:
    """Reports nothing."""


def run_parts(make: Callable[[int], object], count: int, progress: Progress = ignore_progress) -> None:
    """Calls `make` with 0 to `count - 1`, in several threads: numpy's work runs in parallel.

    `progress` is called in the caller's thread. Raises what `make` raises.
    """
    with ThreadPoolExecutor(min(MOST_THREADS, count_available_cores())) as pool:
        for done, _ in enumerate(pool.map(make, range(count)), 1):
            progress(done, count)
