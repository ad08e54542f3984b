"""Protects the parent of worker processes, and its secrets, from other processes of its user."""

from __future__ import annotations

import ctypes
import logging
import os
import platform
from pathlib import Path

_log = logging.getLogger("ciir")
_PR_SET_DUMPABLE = 4
_ENV_START, _ENV_END = 50 - 3, 51 - 3  # fields of /proc/PID/stat, by proc(5), without the first two


def protect(kept: tuple[str, ...]) -> None:
    """Makes this process not dumpable and removes its initial environment from /proc. Logs what can't be done.

    After that, processes of the same user can't read or write its memory, its environment and its open files. `kept`:
    prefixes of the names of variables that are not secret and stay as they are. `os.environ` does not change. Call it
    while the process has only one thread.
    """
    if platform.system() != "Linux":
        _log.warning("other processes of this user may read the secrets of this one: no prctl on %s", platform.system())
        return
    _erase_environment(kept)
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0) != 0:
        reason = os.strerror(ctypes.get_errno())
        _log.warning("other processes of this user can read the secrets of this one: %s", reason)


def _erase_environment(kept: tuple[str, ...]) -> None:
    """Overwrites the values in the memory that /proc/PID/environ shows, where the system put them at the start."""
    for name, value in os.environ.items():
        os.putenv(name, value)  # from now on the C library's environment refers to copies
    fields = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    address, end = int(fields[_ENV_START]), int(fields[_ENV_END])
    for entry in ctypes.string_at(address, end - address).split(b"\0"):
        variable, _, secret = entry.partition(b"=")
        if not os.fsdecode(variable).startswith(kept):
            ctypes.memset(address + len(entry) - len(secret), 0, len(secret))
        address += len(entry) + 1
