"""The memory of this process, and what the system has left."""

from __future__ import annotations

import ctypes
from pathlib import Path

HEAPS = 2
"""Of `ciir serve` and `ciir worker`, whose threads mostly wait, and of `ciir reconstruct`, which is no slower so."""
SYSTEM = Path("/proc")
"""Where Linux describes itself: proc(5)."""
_M_ARENA_MAX = -8  # malloc.h


def limit_heaps(most: int) -> None:
    """Has all threads of this process share `most` heaps: each keeps memory that was freed in it.

    By default there are 8 for each core. Has no effect on other C libraries than glibc. Call it while the process has
    one thread.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(_M_ARENA_MAX, most)


def may_lack(wanted: int) -> bool:
    """Whether the system would refuse a process `wanted` bytes of memory: only where it promises no more than it has.

    That is vm.overcommit_memory=2 of Linux; otherwise the system ends processes when memory is short.
    """
    try:
        mode = (SYSTEM / "sys/vm/overcommit_memory").read_text()
        lines = (SYSTEM / "meminfo").read_text().splitlines()
    except FileNotFoundError:  # another system
        return False
    kibibytes = {name: int(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines)}
    return mode.strip() == "2" and 1024 * (kibibytes["CommitLimit"] - kibibytes["Committed_AS"]) < wanted
