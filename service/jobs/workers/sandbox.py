"""Restrictions on a worker process: no sockets, and limits on memory, files and processor time.

It is imported before anything else in a worker process. See seccomp(2), prctl(2) and setrlimit(2) of Linux.
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import signal
import struct

_OPEN_FILES = 1024
_ARENAS = 4
"""Heaps that threads share: by default there are 8 for each core, each with 64 MiB of address space."""
_M_ARENA_MAX = -8  # malloc.h
_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_SET_MODE_FILTER, _FLAG_TSYNC = 1, 1
_ALLOW, _ERRNO, _KILL_PROCESS = 0x7FFF0000, 0x00050000, 0x80000000
_LOAD, _JUMP_EQUAL, _JUMP_AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06  # classic BPF: LD|W|ABS, JEQ|K, JGE|K, RET|K
_X32 = 0x40000000
_SYSTEMS = {
    # machine: (AUDIT_ARCH_..., seccomp, socket, io_uring_setup), by linux/audit.h and the tables of system calls
    "x86_64": (0xC000003E, 317, 41, 425),
    "aarch64": (0xC00000B7, 277, 198, 425),
}

missing: list[str] = []
"""Restrictions that this process lacks, one sentence each; set by `enter`."""


def enter(memory: int, file: int, parent: int) -> None:
    """Restricts this process for the rest of its life, and makes it end with the process id `parent`.

    `memory`: bytes of address space; `file`: bytes of each file that it writes. Sets `missing`.
    """
    if hasattr(_libc(), "mallopt"):  # glibc
        _libc().mallopt(_M_ARENA_MAX, _ARENAS)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a service manager sends it to all; the parent ends its workers
    missing[:] = [*_die_with(parent), *_forbid_sockets()]
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
            missing.append(f"{name} can't be set ({error})")


def allow_cpu(seconds: int) -> None:
    """Allows so much processor time from now on, for all threads together; then SIGXCPU ends the process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = int(used.ru_utime + used.ru_stime) + 1 + seconds
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (until if hard == resource.RLIM_INFINITY else min(until, hard), hard))


def _die_with(parent: int) -> list[str]:
    """Makes the system kill this process when its parent is killed."""
    if platform.system() != "Linux":
        return [f"it outlives a parent that is killed: {platform.system()} has no way to end with it"]
    if _libc().prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        return [f"it outlives a parent that is killed ({os.strerror(ctypes.get_errno())})"]
    if os.getppid() != parent:  # it was killed before
        os.kill(os.getpid(), signal.SIGKILL)
    return []


def _forbid_sockets() -> list[str]:
    """Makes `socket` fail with `EACCES` in every thread and child process. Socket pairs are still allowed."""
    known = _SYSTEMS.get(platform.machine())
    if known is None or platform.system() != "Linux":
        return [f"it can reach the network: no filter is known for {platform.system()} on {platform.machine()}"]
    code, seccomp, socket, io_uring_setup = known
    refuse = _ERRNO | 13  # EACCES
    program = b"".join(
        struct.pack("=HBBI", *step)
        for step in (
            (_LOAD, 0, 0, 4),  # seccomp_data.arch: 32-bit calls have other numbers
            (_JUMP_EQUAL, 1, 0, code),
            (_RETURN, 0, 0, _KILL_PROCESS),
            (_LOAD, 0, 0, 0),  # seccomp_data.nr
            (_JUMP_AT_LEAST, 3, 0, _X32),
            (_JUMP_EQUAL, 2, 0, socket),
            (_JUMP_EQUAL, 1, 0, io_uring_setup),  # it can open sockets without the call
            (_RETURN, 0, 0, _ALLOW),
            (_RETURN, 0, 0, refuse),
        )
    )
    steps = ctypes.create_string_buffer(program, len(program))
    filter_ = struct.pack("@HP", len(program) // 8, ctypes.addressof(steps))
    libc = _libc()
    if libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 or libc.syscall(
        seccomp, _SET_MODE_FILTER, _FLAG_TSYNC, filter_
    ):
        return [f"it can reach the network: seccomp is not available ({os.strerror(ctypes.get_errno())})"]
    return []


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
