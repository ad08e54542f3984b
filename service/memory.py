"""The memory of this process, and what the system has left."""

from __future__ import annotations

import ctypes
from pathlib import Path

HEAPS = 2
"""Heaps for `ciir serve` and `ciir worker`, whose threads mostly wait, and for `ciir reconstruct`, which isn't
slower."""
SYSTEM = Path("/proc")
"""The place where Linux describes itself: proc(5)."""
_M_ARENA_MAX = -8  # malloc.h


def limit_heaps(most: int) -> None:
    """Makes all threads of this process share `most` heaps, because each heap keeps the memory that was freed in it.

    By default there are 8 for each core. This has no effect with C libraries other than glibc. Call it while the
    process has only one thread.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(_M_ARENA_MAX, most)


def may_lack(wanted: int) -> bool:
    """Checks whether the system would refuse a process `wanted` bytes of memory.

    It only does so if it promises no more than it has (vm.overcommit_memory=2 on Linux). Otherwise the system ends
    processes when memory is short.
    """
    try:
        mode = (SYSTEM / "sys/vm/overcommit_memory").read_text()
        lines = (SYSTEM / "meminfo").read_text().splitlines()
    except FileNotFoundError:  # not Linux
        return False
    kibibytes = {name: int(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines)}
    return mode.strip() == "2" and 1024 * (kibibytes["CommitLimit"] - kibibytes["Committed_AS"]) < wanted
