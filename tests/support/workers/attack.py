"""The code that runs in a compromised worker process. Tests put this text into an upload and set `ATTACK` before it.

It tries everything that a worker must not be able to do, and raises an error that lists what was possible.
"""

import ctypes
import errno
import fcntl
import json
import os
import signal
import socket
import struct
import subprocess
import sys

from ciir.errors import Unreadable

ATTACK = globals().get("ATTACK", {})
libc = ctypes.CDLL(None, use_errno=True)
parent, folder = os.getppid(), ATTACK.get("folder", "/nowhere")
is_arm = os.uname().machine == "aarch64"


def call(x86, arm, *arguments):
    found = libc.syscall(arm if is_arm else x86, *(ctypes.c_long(a) if isinstance(a, int) else a for a in arguments))
    if found == -1:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return found


def read(path):
    with open(path, "rb") as file:  # noqa: PTH123 - as short as it can be
        return file.read(100)


def write(path):
    with open(path, "r+b"):  # noqa: PTH123
        pass


def start_program():
    return subprocess.run(["/bin/true"], check=True)


def fork():
    pid = os.fork()
    if pid == 0:
        os._exit(0)
    os.waitpid(pid, 0)


def connect_datagrams():
    one, _ = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    one.connect(ATTACK["datagrams"])


def own_signals():
    reading, _ = os.pipe()
    fcntl.fcntl(reading, fcntl.F_SETOWN, parent)


def read_memory(pid):
    buffer = ctypes.create_string_buffer(8)
    local = struct.pack("PN", ctypes.addressof(buffer), 8)
    remote = struct.pack("PN", 0x1000, 8)
    return call(310, 270, pid, local, 1, remote, 1, 0)


def write_memory(pid):
    local = struct.pack("PN", ctypes.addressof(ctypes.create_string_buffer(8)), 8)
    return call(311, 271, pid, local, 1, struct.pack("PN", 0x1000, 8), 1, 0)


def find_open_files():
    """Finds open files besides those of the protocol, which could be the parent's."""
    allowed = {"input", "result", "channel"}
    found = []
    for number in range(3, 1024):
        try:
            target = os.readlink(f"/proc/self/fd/{number}")  # noqa: PTH115
        except OSError:
            continue
        if folder in target and not target.endswith("(deleted)") and "/inputs/" not in target:
            found.append(target)
    if not found:
        raise OSError(errno.EACCES, f"none but {allowed}")
    return found


def read_environment():
    if "swordfish" not in str(os.environ) and b"swordfish" not in read("/proc/self/environ"):
        raise OSError(errno.EACCES, "no secret in it")
    return "a secret"


ATTEMPTS = {
    "environment of the parent": lambda: read(f"/proc/{parent}/environ"),
    "memory of the parent": lambda: write(f"/proc/{parent}/mem"),
    "maps of the parent": lambda: read(f"/proc/{parent}/maps"),
    "open files of the parent": lambda: os.listdir(f"/proc/{parent}/fd"),  # noqa: PTH208
    "command line of the parent": lambda: read(f"/proc/{parent}/cmdline"),
    "environment of process 1": lambda: read("/proc/1/environ"),
    "memory of another worker": lambda: write(f"/proc/{ATTACK['sibling']}/mem"),
    "list of processes": lambda: os.listdir("/proc"),  # noqa: PTH208
    "own environment": read_environment,
    "own open files": find_open_files,
    "ptrace": lambda: call(101, 117, 16, parent, 0, 0),
    "process_vm_readv": lambda: read_memory(parent),
    "process_vm_writev": lambda: write_memory(parent),
    "pidfd_open": lambda: os.pidfd_open(parent),
    "pidfd_getfd": lambda: call(438, 438, 0, 0, 0),
    "pidfd_send_signal": lambda: call(424, 424, 0, 0, None, 0),
    "kill": lambda: os.kill(parent, signal.SIGURG),
    "kill the group": lambda: os.kill(0, 0),
    "kill all": lambda: os.kill(-1, 0),
    "tgkill": lambda: call(234, 131, parent, parent, 0),
    "tkill": lambda: call(200, 130, parent, 0),
    "sigqueue": lambda: call(129, 138, parent, signal.SIGURG, bytes(128)),
    "signals by a pipe": own_signals,
    "lease on a file": lambda: fcntl.fcntl(os.open("/dev/zero", os.O_RDONLY), 1024, fcntl.F_RDLCK),
    "notice of a folder": lambda: fcntl.fcntl(os.open("/usr", os.O_RDONLY), fcntl.F_NOTIFY, fcntl.DN_ACCESS),
    "prlimit": lambda: call(302, 261, parent, 7, struct.pack("QQ", 64, 64), None),
    "priority": lambda: os.setpriority(os.PRIO_PROCESS, parent, 19),
    "affinity": lambda: os.sched_setaffinity(parent, {0}),
    "scheduler": lambda: os.sched_setscheduler(parent, os.SCHED_IDLE, os.sched_param(0)),
    "outliving the parent": lambda: call(157, 167, 1, 0, 0, 0, 0),
    "kcmp": lambda: call(312, 272, parent, os.getpid(), 1, 0, 0),
    "socket": lambda: socket.create_connection(("127.0.0.1", ATTACK["port"])),
    "socket of datagrams": connect_datagrams,
    "io_uring": lambda: call(425, 425, 1, None),
    "program": start_program,
    "fork": fork,
    "namespace": lambda: call(272, 97, 0x10000000),
    "mount": lambda: call(165, 40, b"none", b"/tmp", b"tmpfs", 0, None),
    "bpf": lambda: call(321, 280, 0, bytes(64), 64),
    "perf_event_open": lambda: call(298, 241, bytes(128), parent, -1, -1, 0),
    "userfaultfd": lambda: call(323, 282, 1),
    "keyctl": lambda: call(250, 219, 0, -3, 0),
    "shared memory": lambda: call(29, 194, 0, 4096, 0o1600),
    "database": lambda: read(f"{folder}/jobs.db"),
    "database, to write": lambda: write(f"{folder}/jobs.db"),
    "list of inputs": lambda: os.listdir(f"{folder}/files/inputs"),  # noqa: PTH208
    "list of results": lambda: os.listdir(f"{folder}/files/results"),  # noqa: PTH208
    "result of another job": lambda: read(ATTACK["result"]),
    "result of another job, to write": lambda: write(ATTACK["result"]),
    "mode of another file": lambda: os.chmod(ATTACK["result"], 0o777),  # noqa: PTH101, S103
    "times of another file": lambda: os.utime(ATTACK["result"], (0, 0)),
    "length of another file": lambda: os.truncate(ATTACK["result"], 0),
    "removal of another file": lambda: os.unlink(ATTACK["result"]),  # noqa: PTH108
    "new file": lambda: os.open("/tmp/of-a-worker", os.O_CREAT | os.O_WRONLY),  # noqa: S108
    "new file of jobs": lambda: os.open(f"{folder}/new", os.O_CREAT | os.O_WRONLY),
    "package": lambda: write(sys.modules["ciir"].__file__),
    "system's users": lambda: read("/etc/passwd"),
    "files of the tests": lambda: read(ATTACK["folder"] + "/../secret"),
}


def attempt(function):
    try:
        return f"possible: {function()!r}"[:200]
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM, errno.ENOSYS, errno.EXDEV):
            return "refused"
        return f"failed: {error}"


if ATTACK:
    raise Unreadable("FOUND" + json.dumps({name: attempt(function) for name, function in ATTEMPTS.items()}))
