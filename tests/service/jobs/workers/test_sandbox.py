"""Each test restricts a process of its own, as restrictions can't be lifted."""

import os
import platform
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ciir.service.jobs.workers import sandbox
from tests.support.paths import ROOT
from tests.support.waiting import wait_until

ENTER = """
import os, sys
from ciir.service.jobs.workers import sandbox
sandbox.enter(memory=2**30, file=2**20, parent=os.getppid())
"""


def run(code, before=ENTER):
    return subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", before + code], capture_output=True, text=True, cwd=ROOT, timeout=60, check=False
    )


def get_lines(code, before=ENTER):
    done = run(code, before)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def start(code):
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=ROOT, text=True)  # noqa: S603


pytestmark = pytest.mark.skipif(platform.system() != "Linux", reason="the restrictions are for Linux")


@pytest.mark.skipif(platform.machine() not in sandbox._SYSTEMS, reason="no filter is known for this processor")
def test_no_thread_and_no_child_gets_a_socket():
    lines = get_lines("""
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
one, other = socket.socketpair()  # allowed
one.send(b"refused")
print(other.recv(7).decode())
io_uring_setup = 425
ctypes.CDLL(None, use_errno=True).syscall(io_uring_setup, 1, None)
print(ctypes.get_errno())
""")
    assert lines == ["[]", *["refused"] * 7, "13"]


def test_an_earlier_thread_gets_no_socket_either():
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
    assert get_lines("go.set()\nthread.join()", before + ENTER) == ["refused"]


def test_memory_is_limited():
    assert get_lines("""
try:
    bytearray(2**30)
except MemoryError:
    print("refused")
""") == ["refused"]


def test_file_sizes_are_limited(tmp_path):
    path = tmp_path / "file"
    assert get_lines(f"""
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


def test_open_files_are_limited_and_no_core_is_dumped():
    assert get_lines("""
import resource
print(resource.getrlimit(resource.RLIMIT_NOFILE), resource.getrlimit(resource.RLIMIT_CORE))
""") == ["(1024, 1024) (0, 0)"]


def test_processor_time_is_limited_for_each_task():
    done = run("""
import time
def work(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass
sandbox.allow_cpu(0)  # until the current second ends
work(0.5)
sandbox.allow_cpu(1)
work(0.7)
print("alive", flush=True)
sandbox.allow_cpu(0)
work(10)
""")
    assert (done.stdout, done.returncode) == ("alive\n", -signal.SIGXCPU)


def test_the_process_ends_with_its_parent():
    child = ENTER + "print(os.getpid(), flush=True)\nimport time\ntime.sleep(60)"
    parent = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {child!r}])"
    with start(parent) as process:
        pid = int(process.stdout.readline())
        assert is_alive(pid)
        process.kill()
    wait_until(lambda: not is_alive(pid), 30)


def is_alive(pid):
    """Whether the process lives and is not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_a_parent_that_is_dead_already():
    done = run("sandbox.enter(2**30, 2**20, 1 + os.getppid())\nprint('alive')")
    assert (done.stdout, done.returncode) == ("", -signal.SIGKILL)


def test_sigterm_is_ignored():
    assert get_lines("import signal\nos.kill(os.getpid(), signal.SIGTERM)\nprint('alive')") == ["alive"]


def test_missing_restrictions_are_reported(monkeypatch):
    monkeypatch.setattr(sandbox.platform, "machine", lambda: "other")
    assert sandbox._forbid_sockets() == ["it can reach the network: no filter is known for Linux on other"]
    monkeypatch.setattr(sandbox.platform, "system", lambda: "Other")
    (line,) = sandbox._die_with(os.getppid())
    assert line == "it outlives a parent that is killed: Other has no way to end with it"


def test_lower_limits_stay():
    lines = get_lines("""
import resource
resource.setrlimit(resource.RLIMIT_NOFILE, (100, 100))
sandbox.enter(2**30, 2**19, os.getppid())
print(resource.getrlimit(resource.RLIMIT_NOFILE), resource.getrlimit(resource.RLIMIT_FSIZE), sandbox.missing)
""")
    assert lines == [f"(100, 100) ({2**19}, {2**19}) []"]


def test_it_imports_nothing_heavy():
    heavy = "{'numpy', 'pydantic', 'onnxruntime', 'ciir.renderer', 'ciir.models'}"
    assert get_lines(f"print(sorted({heavy} & set(sys.modules)))") == ["[]"]
