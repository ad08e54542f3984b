"""Calls that don't need one another, side by side: each in a thread of its own, as many at once as there are cores."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Item = TypeVar("Item")

FULL = 2
"""Rounds that all cores must be busy for. Of fewer calls the last ones would leave cores idle for too long: a single
view is quicker where all cores share its network."""


def suits(count: int, cores: int) -> bool:
    """Whether `count` calls are quicker side by side, each on one of `cores`, than one after the other on all."""
    return cores > 1 and count >= FULL * cores


def each(work: Callable[[Item], object], items: Sequence[Item], cores: int) -> None:
    """Does `work` for each of `items`, up to `cores` at once; in the caller's thread, in order, where that is one.

    The first error in the order of `items` is raised, and by then no thread is left and no further item is begun.
    """
    if cores == 1:
        for item in items:
            work(item)
        return
    with ThreadPoolExecutor(cores, thread_name_prefix="abreast") as pool:
        coming = [pool.submit(work, item) for item in items]
        try:
            for one in coming:
                one.result()
        finally:
            for one in coming:
                one.cancel()
