"""Enters the sandbox: limits on memory, files and processor time, no capabilities, Landlock, seccomp.

It is imported before anything else in a worker process. See prctl(2), capset(2) and setrlimit(2) of Linux.
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import signal
import struct
from typing import TYPE_CHECKING

from ciir.service.jobs.workers.sandbox import landlock, seccomp
from ciir.service.memory import limit_heaps

if TYPE_CHECKING:
    from collections.abc import Sequence

_OPEN_FILES = 1024
_HEAPS = 4
"""Each heap takes 64 MiB of address space."""
_PR_SET_PDEATHSIG, _PR_SET_DUMPABLE, _PR_SET_NO_NEW_PRIVS = 1, 4, 38
_CAPABILITY_VERSION_3 = 0x20080522

missing: list[str] = []
"""Restrictions that this process lacks, one sentence each; set by `enter`."""


def enter(memory: int, file: int, parent: int, readable: Sequence[str] = ()) -> None:
    """Restricts this process for the rest of its life, and makes it end with the process id `parent`.

    `memory`: bytes of address space; `file`: bytes of each file that it writes; `readable`: files that it may open in
    addition to libraries. Sets `missing`. Call it while the process has only one thread, because capabilities and
    Landlock apply to a thread and those that it starts. Raises `PermissionError` if the libraries can be read only with
    root's capabilities.
    """
    limit_heaps(_HEAPS)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)  # a service manager sends it to all; the parent ends its workers
    missing[:] = _set_limits(memory, file)
    if platform.system() != "Linux":
        missing.append(f"it can use all that its user can: {platform.system()} has no seccomp and no Landlock")
        return
    _die_with(parent)
    _prctl(_PR_SET_DUMPABLE, 0)  # no other process of its user reads its memory
    _prctl(_PR_SET_NO_NEW_PRIVS, 1)
    header = struct.pack("=Ii", _CAPABILITY_VERSION_3, 0)
    if _libc().capset(header, bytes(24)) != 0:
        missing.append(f"it keeps its capabilities ({_describe_errno()})")
    missing.extend(landlock.restrict(readable))
    missing.extend(seccomp.restrict())


def allow_cpu(seconds: int) -> None:
    """Allows `seconds` of processor time from now on, for all threads together; then SIGXCPU ends the process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = int(used.ru_utime + used.ru_stime) + 1 + seconds
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (until if hard == resource.RLIM_INFINITY else min(until, hard), hard))


def _set_limits(memory: int, file: int) -> list[str]:
    lacking = []
    for name, limit in (
        ("RLIMIT_AS", memory),
        ("RLIMIT_FSIZE", file),
        ("RLIMIT_NOFILE", _OPEN_FILES),
        ("RLIMIT_CORE", 0),
    ):
        try:
            which = getattr(resource, name)
            hard = resource.getrlimit(which)[1]
            lower = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
            resource.setrlimit(which, (lower, lower))
        except (AttributeError, OSError, ValueError) as error:
            lacking.append(f"{name} can't be set ({error})")
    return lacking


def _die_with(parent: int) -> None:
    """Makes the system kill this process when its parent is killed."""
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has already been killed
        os.kill(os.getpid(), signal.SIGKILL)


def _prctl(option: int, value: int) -> None:
    if _libc().prctl(option, value, 0, 0, 0) != 0:
        missing.append(f"prctl {option} can't be set to {value} ({_describe_errno()})")


def _describe_errno() -> str:
    return os.strerror(ctypes.get_errno())


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
