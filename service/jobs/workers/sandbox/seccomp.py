"""A filter of system calls, by seccomp(2): no sockets, programs or child processes, and no access to other processes.

It also refuses what Landlock does not restrict: permissions, owners and times of files, and System V shared objects.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct

_SET_MODE_FILTER, _FLAG_TSYNC = 1, 1
_ALLOW, _ERRNO, _KILL_PROCESS = 0x7FFF0000, 0x00050000, 0x80000000
_EACCES, _ENOSYS = 13, 38
_LOAD, _RETURN = 0x20, 0x06  # classic BPF: LD|W|ABS, RET|K
_JUMP_EQUAL, _JUMP_AT_LEAST, _JUMP_SET = 0x15, 0x35, 0x45  # JEQ|K, JGE|K, JSET|K
_X32 = 0x40000000
_CLONE_THREAD = 0x10000
_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
"""AUDIT_ARCH_... of linux/audit.h."""

REFUSED = {
    # name: (x86_64, aarch64) by the kernel's tables; None where a machine lacks the call
    # Networks
    "socket": (41, 198), "socketpair": (53, 199), "connect": (42, 203), "bind": (49, 200), "listen": (50, 201),
    "accept": (43, 202), "accept4": (288, 242),
    "io_uring_setup": (425, 425), "io_uring_enter": (426, 426), "io_uring_register": (427, 427),
    # Programs and processes
    "execve": (59, 221), "execveat": (322, 281), "fork": (57, None), "vfork": (58, None),
    "ptrace": (101, 117), "process_vm_readv": (310, 270), "process_vm_writev": (311, 271), "kcmp": (312, 272),
    "process_madvise": (440, 440), "process_mrelease": (448, 448), "move_pages": (279, 239),
    "migrate_pages": (256, 238), "pidfd_open": (434, 434), "pidfd_getfd": (438, 438),
    "pidfd_send_signal": (424, 424), "tkill": (200, 130), "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240), "setpriority": (141, 140), "ioprio_set": (251, 30),
    "sched_setscheduler": (144, 119), "sched_setparam": (142, 118), "sched_setattr": (314, 274),
    # The kernel
    "bpf": (321, 280), "perf_event_open": (298, 241), "userfaultfd": (323, 282), "syslog": (103, 116),
    "add_key": (248, 217), "request_key": (249, 218), "keyctl": (250, 219),
    # Mounts and namespaces
    "mount": (165, 40), "umount2": (166, 39), "pivot_root": (155, 41), "chroot": (161, 51), "unshare": (272, 97),
    "setns": (308, 268), "open_tree": (428, 428), "move_mount": (429, 429), "fsopen": (430, 430),
    "fsconfig": (431, 431), "fsmount": (432, 432), "fspick": (433, 433), "mount_setattr": (442, 442),
    "open_by_handle_at": (304, 265),
    # Files, as far as Landlock allows them
    "chmod": (90, None), "fchmod": (91, 52), "fchmodat": (268, 53), "fchmodat2": (452, 452), "chown": (92, None),
    "lchown": (94, None), "fchown": (93, 55), "fchownat": (260, 54), "utime": (132, None), "utimes": (235, None),
    "futimesat": (261, None), "utimensat": (280, 88), "setxattr": (188, 5), "lsetxattr": (189, 6),
    "fsetxattr": (190, 7), "setxattrat": (463, 463), "removexattr": (197, 14), "lremovexattr": (198, 15),
    "fremovexattr": (199, 16), "removexattrat": (466, 466), "file_setattr": (469, 469), "truncate": (76, 45),
    "fallocate": (285, 47),  # it can reserve disk space beyond RLIMIT_FSIZE
    "inotify_init": (253, None), "inotify_init1": (294, 26), "fanotify_init": (300, 262),
    # Shared memory, semaphores and messages by name
    "shmget": (29, 194), "shmat": (30, 196), "shmctl": (31, 195), "semget": (64, 190), "semop": (65, 193),
    "semctl": (66, 191), "semtimedop": (220, 192), "msgget": (68, 186), "msgctl": (71, 187), "msgsnd": (69, 189),
    "msgrcv": (70, 188), "mq_open": (240, 180), "mq_unlink": (241, 181),
}  # fmt: skip
"""System calls that fail with `EACCES`."""
_CLONE3 = 435
"""Filters can't see its flags, so it is made to look missing; the C library then uses `clone`."""


def restrict() -> list[str]:
    """Filters the system calls of every thread of this process. Returns what could not be restricted."""
    machine = platform.machine()
    if machine not in _ARCHITECTURES:
        return [f"it can reach the network and other processes: no filter is known for Linux on {machine}"]
    program = b"".join(struct.pack("=HBBI", *step) for step in _make_program(machine, os.getpid()))
    steps = ctypes.create_string_buffer(program, len(program))
    filter_ = struct.pack("@HP", len(program) // 8, ctypes.addressof(steps))
    libc = ctypes.CDLL(None, use_errno=True)
    seccomp = 317 if machine == "x86_64" else 277
    if libc.syscall(seccomp, _SET_MODE_FILTER, _FLAG_TSYNC, filter_):
        reason = os.strerror(ctypes.get_errno())
        return [f"it can reach the network and other processes: seccomp is not available ({reason})"]
    return []


def _make_program(machine: str, pid: int) -> list[tuple[int, int, int, int]]:
    """Returns the steps of classic BPF: code, steps to jump if true and if false, value."""
    column = list(_ARCHITECTURES).index(machine)
    refuse = (_RETURN, 0, 0, _ERRNO | _EACCES)
    program = [
        (_LOAD, 0, 0, 4),  # seccomp_data.arch: 32-bit calls have other numbers
        (_JUMP_EQUAL, 1, 0, _ARCHITECTURES[machine]),
        (_RETURN, 0, 0, _KILL_PROCESS),
        (_LOAD, 0, 0, 0),  # seccomp_data.nr
        (_JUMP_AT_LEAST, 0, 1, _X32),
        refuse,
        (_JUMP_EQUAL, 0, 1, _CLONE3),
        (_RETURN, 0, 0, _ERRNO | _ENOSYS),
    ]
    for numbers in REFUSED.values():
        if (number := numbers[column]) is not None:
            program += [(_JUMP_EQUAL, 0, 1, number), refuse]
    for numbers, argument, test, values, allows in _list_rules(pid):
        body = [(_LOAD, 0, 0, 16 + 8 * argument)]  # the low 32 bits of seccomp_data.args[argument]
        on_match, otherwise = ((_RETURN, 0, 0, _ALLOW), refuse) if allows else (refuse, (_RETURN, 0, 0, _ALLOW))
        for value in values:
            body += [(test, 0, 1, value), on_match]
        body.append(otherwise)
        program += [(_JUMP_EQUAL, 0, len(body), numbers[column]), *body]
    return [*program, (_RETURN, 0, 0, _ALLOW)]


def _list_rules(pid: int) -> list[tuple[tuple[int, int], int, int, tuple[int, ...], bool]]:
    """Lists calls that an argument decides: (x86_64, aarch64), which argument, test, values, whether a match allows."""
    return [
        ((56, 220), 0, _JUMP_SET, (_CLONE_THREAD,), True),  # clone: threads, no processes
        ((62, 129), 0, _JUMP_EQUAL, (pid,), True),  # kill
        ((234, 131), 0, _JUMP_EQUAL, (pid,), True),  # tgkill: abort() signals its own thread
        ((302, 261), 0, _JUMP_EQUAL, (0, pid), True),  # prlimit64
        ((203, 122), 0, _JUMP_EQUAL, (0, pid), True),  # sched_setaffinity
        ((157, 167), 0, _JUMP_EQUAL, (1,), False),  # prctl: PR_SET_PDEATHSIG stays
        # fcntl: F_SETOWN, F_SETSIG, F_SETOWN_EX and F_NOTIFY send signals; F_SETLEASE delays others that open the file
        ((72, 25), 1, _JUMP_EQUAL, (8, 10, 15, 1024, 1026), False),
        ((16, 29), 1, _JUMP_EQUAL, (0x8901, 0x8902), False),  # ioctl: FIOSETOWN, SIOCSPGRP
    ]
