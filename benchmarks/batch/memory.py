"""Measures the most memory that a command and all its processes hold at once.

python -m ciir.benchmarks.batch.memory batch film.mp4 -o out --lenses 100x100
"""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING, NamedTuple

import psutil

if TYPE_CHECKING:
    from collections.abc import Sequence

LOOK_SECONDS = 0.1


class Usage(NamedTuple):
    """The time and memory that a command took."""

    seconds: float
    total: int
    """Bytes of all processes together; shared ones count once."""
    largest: int
    """Resident bytes of the largest process."""
    status: int


def measure(arguments: Sequence[str]) -> Usage:
    """Runs `ciir` with these arguments and measures it."""
    begun, total, largest = time.perf_counter(), 0, 0
    with subprocess.Popen([sys.executable, "-m", "ciir", *arguments]) as process:
        top = psutil.Process(process.pid)
        while process.poll() is None:
            time.sleep(LOOK_SECONDS)
            sizes = [_read_sizes(each) for each in (top, *_list_children(top))]
            total = max(total, sum(size for size, _ in sizes))
            largest = max(largest, *(resident for _, resident in sizes))
    return Usage(time.perf_counter() - begun, total, largest, process.returncode)


def _list_children(top: psutil.Process) -> list[psutil.Process]:
    try:
        return list(top.children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def _read_sizes(process: psutil.Process) -> tuple[int, int]:
    """Returns bytes with shared ones counted by their share, and resident bytes; 0 for a process that has ended."""
    try:
        info = process.memory_full_info()
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return 0, 0
    return info.pss, info.rss


if __name__ == "__main__":
    used = measure(sys.argv[1:])
    print(f"{used.seconds:.0f} s, {used.total >> 20} MiB together, {used.largest >> 20} MiB in the largest process")
    sys.exit(used.status)
