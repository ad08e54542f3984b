"""The heaps of the C library: fewer for threads to share, because each keeps memory that was freed in it."""

from __future__ import annotations

import ctypes

SERVER_HEAPS = 2
"""Of `ciir serve` and `ciir worker`, whose threads mostly wait."""
_M_ARENA_MAX = -8  # malloc.h


def limit_heaps(most: int) -> None:
    """Has all threads of this process share `most` heaps; by default there are 8 for each core.

    Has no effect on other C libraries than glibc. Call it while the process has one thread.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(_M_ARENA_MAX, most)
