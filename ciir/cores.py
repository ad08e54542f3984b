"""The number of processor cores that this process may use, within its container's quota."""

from __future__ import annotations

import math
import os
from functools import cache
from pathlib import Path, PurePosixPath

GROUPS, MEMBERSHIP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")

most_cores: int | None = None
"""The limit for a worker process that shares a machine with others; None for no such limit."""


def count_available_cores() -> int:
    """Returns the number of cores that this process can keep busy, at least 1."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(math.ceil(min(allowed, read_quota())), most_cores or allowed))


@cache
def read_quota() -> float:
    """Returns the number of cores whose time Linux's control groups allow this process; infinity without a limit.

    The result of the first call is kept, because a worker process can't read the quota once it is in its sandbox.
    Every group limits the groups in it (cgroups(7)). In a container, the root of the groups' file system is the
    container's own group.
    """
    try:
        lines = MEMBERSHIP.read_text().splitlines()
    except OSError:
        return math.inf
    inside = {PurePosixPath(line.split(":", 2)[-1].lstrip("/")) for line in lines}
    groups = {group for path in inside for group in (path, *path.parents)}
    mounts = (GROUPS, GROUPS / "unified", GROUPS / "cpu")
    return min((_read_group(mount / group) for mount in mounts for group in groups), default=math.inf)


def _read_group(folder: Path) -> float:
    """Returns the quota of a group of version 2 or 1, in cores; infinity if it has none."""
    try:
        quota, period = (folder / "cpu.max").read_text().split()
    except OSError:
        try:
            quota, period = ((folder / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
        except OSError:
            return math.inf
    return math.inf if quota.strip() in ("max", "-1") else int(quota) / int(period)
