"""Each in a process of its own: what is given up there can't be had back."""

import os
import platform
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ciir.service.jobs.workers import sandbox
from tests.support.paths import ROOT

ENTER = """
import os, sys
from ciir.service.jobs.workers import sandbox
sandbox.enter(sandbox.Bounds(memory=2**30, file=2**20), os.getppid())
"""


def run(code, before=ENTER):
    return subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", before + code], capture_output=True, text=True, cwd=ROOT, timeout=60, check=False
    )


def told(code, before=ENTER):
    done = run(code, before)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def started(code):
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=ROOT, text=True)  # noqa: S603


pytestmark = pytest.mark.skipif(platform.system() != "Linux", reason="limits are Linux's")


@pytest.mark.skipif(platform.machine() not in sandbox._SYSTEMS, reason="no filter is known for this processor")
def test_no_socket_is_to_be_had_by_any_thread_or_child():
    lines = told("""
import ctypes, socket, subprocess, threading
print(sandbox.missing)
def attempt(family):
    try:
        socket.socket(family)
        print("a socket")
    except PermissionError as error:
        print("refused")
for family in (socket.AF_INET, socket.AF_INET6, socket.AF_UNIX, socket.AF_NETLINK):
    attempt(family)
thread = threading.Thread(target=attempt, args=(socket.AF_INET,))
thread.start()
thread.join()
sys.stdout.flush()
child = "import socket\\ntry: socket.socket()\\nexcept PermissionError: print('refused')"
subprocess.run([sys.executable, "-c", child])
left, right = socket.socketpair()  # with itself a process may talk
left.send(b"refused")
print(right.recv(7).decode())
io_uring_setup = 425
ctypes.CDLL(None, use_errno=True).syscall(io_uring_setup, 1, None)
print(ctypes.get_errno())
""")
    assert lines == ["[]", *["refused"] * 7, "13"]


def test_a_thread_that_is_there_already_is_kept_in_too():
    before = """
import socket, threading
go = threading.Event()
def attempt():
    go.wait()
    try:
        socket.socket()
    except PermissionError:
        print("refused")
thread = threading.Thread(target=attempt)
thread.start()
"""
    assert told("go.set()\nthread.join()", before + ENTER) == ["refused"]


def test_memory_is_bounded():
    assert told("""
try:
    bytearray(2**30)
except MemoryError:
    print("refused")
""") == ["refused"]


def test_files_are_bounded(tmp_path):
    path = tmp_path / "file"
    assert told(f"""
import errno
try:
    with open({str(path)!r}, "wb") as file:
        file.write(bytes(2**20))
        file.flush()
        file.write(b"1")
except OSError as error:
    print(error.errno == errno.EFBIG)
""") == ["True"]
    assert path.stat().st_size == 2**20


def test_open_files_are_bounded_and_no_core_is_left():
    assert told("""
import resource
print(resource.getrlimit(resource.RLIMIT_NOFILE), resource.getrlimit(resource.RLIMIT_CORE))
""") == ["(1024, 1024) (0, 0)"]


def test_processor_time_is_bounded_for_each_piece_of_work():
    done = run("""
import time
def work(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass
sandbox.allow_cpu(0)  # to the end of the second that has begun
work(0.5)
sandbox.allow_cpu(1)
work(0.7)
print("lives", flush=True)
sandbox.allow_cpu(0)
work(10)
""")
    assert (done.stdout, done.returncode) == ("lives\n", -signal.SIGXCPU)


def test_it_ends_with_its_parent():
    """A parent starts a process that enters and waits; the parent is killed."""
    child = ENTER + "print(os.getpid(), flush=True)\nimport time\ntime.sleep(60)"
    parent = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {child!r}])"
    with started(parent) as process:
        pid = int(process.stdout.readline())
        assert is_there(pid)
        process.kill()
    until = time.monotonic() + 30
    while is_there(pid):
        assert time.monotonic() < until, "the child goes on"
        time.sleep(0.01)


def is_there(pid):
    """Whether the process lives; one that is dead and not yet waited for doesn't."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_a_parent_that_is_gone_already():
    done = run("sandbox.enter(sandbox.Bounds(2**30, 2**20), 1 + os.getppid())\nprint('lives')")
    assert (done.stdout, done.returncode) == ("", -signal.SIGKILL)


def test_sigterm_is_for_the_parent():
    assert told("import signal\nos.kill(os.getpid(), signal.SIGTERM)\nprint('lives')") == ["lives"]


def test_what_a_system_does_not_have_is_told(monkeypatch):
    monkeypatch.setattr(sandbox.platform, "machine", lambda: "other")
    assert sandbox._no_sockets() == ["it can reach the network: no filter is known for Linux on other"]
    monkeypatch.setattr(sandbox.platform, "system", lambda: "Other")
    (line,) = sandbox._die_with(os.getppid())
    assert line == "it outlives a parent that is killed: Other has no way to end with it"


def test_limits_that_are_lower_already_stay():
    lines = told("""
import resource
resource.setrlimit(resource.RLIMIT_NOFILE, (100, 100))
sandbox.enter(sandbox.Bounds(2**30, 2**19), os.getppid())
print(resource.getrlimit(resource.RLIMIT_NOFILE), resource.getrlimit(resource.RLIMIT_FSIZE), sandbox.missing)
""")
    assert lines == [f"(100, 100) ({2**19}, {2**19}) []"]


def test_it_loads_nothing_heavy():
    heavy = "{'numpy', 'pydantic', 'onnxruntime', 'renderer', 'models'}"
    assert told(f"print(sorted({heavy} & set(sys.modules)))") == ["[]"]
