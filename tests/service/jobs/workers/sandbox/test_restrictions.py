"""Each test restricts a process of its own, as restrictions can't be lifted."""

import platform
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.waiting import wait_until

ENTER = """
import os, sys
from ciir.service.jobs.workers.sandbox import restrictions
restrictions.enter(memory=2**30, file=2**20, parent=os.getppid())
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


def test_no_thread_gets_a_socket():
    lines = get_lines("""
import socket, threading
print(restrictions.missing)
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
try:
    socket.socketpair()  # one for datagrams can be connected to other processes
except PermissionError:
    print("refused")
""")
    assert lines == ["[]", *["refused"] * 6]


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


def test_processes_of_its_user_cannot_read_its_memory():
    ask = "import ctypes\nprint(ctypes.CDLL(None).prctl(3, 0, 0, 0, 0))"  # PR_GET_DUMPABLE
    assert get_lines(ask, "") == ["1"]
    assert get_lines(ask) == ["0"]


CALLS = {
    # name: (x86_64, aarch64), arguments with which it succeeds
    "ptrace": ((101, 117), "0"),  # PTRACE_TRACEME
    "process_vm_readv": ((310, 270), "os.getpid(), 0, 0, 0, 0, 0"),
    "process_vm_writev": ((311, 271), "os.getpid(), 0, 0, 0, 0, 0"),
    "kcmp": ((312, 272), "os.getpid(), os.getpid(), 0, 0, 0"),
}


@pytest.mark.parametrize("name", CALLS)
def test_the_filter_alone_refuses_to_reach_into_processes(name):
    numbers, arguments = CALLS[name]
    number = dict(zip(("x86_64", "aarch64"), numbers, strict=True)).get(platform.machine())
    if number is None:
        pytest.skip("no filter is known for this machine")
    filtered = """
import ctypes, errno, os
from ciir.service.jobs.workers.sandbox import seccomp
libc = ctypes.CDLL(None, use_errno=True)
libc.prctl(38, 1, 0, 0, 0)  # PR_SET_NO_NEW_PRIVS
assert seccomp.restrict() == []
"""
    lines = get_lines(f"print(libc.syscall({number}, {arguments}), errno.errorcode[ctypes.get_errno()])", filtered)
    assert lines == ["-1 EACCES"]


def test_memory_is_limited():
    assert get_lines("""
try:
    bytearray(2**30)
except MemoryError:
    print("refused")
""") == ["refused"]


def test_file_sizes_are_limited(tmp_path):
    path = tmp_path / "file"
    before = f"opened = open({str(path)!r}, 'wb')\n" + ENTER
    assert get_lines(
        """
import errno
try:
    with opened as file:
        file.write(bytes(2**20))
        file.flush()
        file.write(b"1")
except OSError as error:
    print(error.errno == errno.EFBIG)
""",
        before,
    ) == ["True"]
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
restrictions.allow_cpu(0)  # until the current second ends
work(0.5)
restrictions.allow_cpu(1)
work(0.7)
print("alive", flush=True)
restrictions.allow_cpu(0)
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
    done = run("print('alive')", ENTER.replace("getppid()", "getppid() + 1"))
    assert (done.stdout, done.returncode) == ("", -signal.SIGKILL)


def test_sigterm_is_ignored():
    assert get_lines("import signal\nos.kill(os.getpid(), signal.SIGTERM)\nprint('alive')") == ["alive"]


def test_missing_restrictions_are_reported():
    lines = get_lines(
        "print(*restrictions.missing, sep='\\n')",
        "import platform\nplatform.machine = lambda: 'other'\n" + ENTER,
    )
    assert [line.partition(":")[0] for line in lines] == [
        "it can open all files of its user",
        "it can reach the network and other processes",
    ]
    (line,) = get_lines("print(*restrictions.missing)", "import platform\nplatform.system = lambda: 'Other'\n" + ENTER)
    assert line == "it can use all that its user can: Other has no seccomp and no Landlock"


def test_a_kernel_without_landlock_is_reported():
    before = """
import os, sys
from ciir.service.jobs.workers.sandbox import landlock, restrictions
def fail(*arguments):
    raise OSError(95, os.strerror(95))
landlock._call = fail
restrictions.enter(memory=2**30, file=2**20, parent=os.getppid())
"""
    (line,) = get_lines("print(*restrictions.missing)", before)
    assert line == "it can open all files of its user: the kernel has no Landlock (Operation not supported)"


def test_lower_limits_stay():
    before = "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, (100, 100))\n" + ENTER
    (line,) = get_lines("print(resource.getrlimit(resource.RLIMIT_NOFILE), restrictions.missing)", before)
    assert line == "(100, 100) []"


def test_it_imports_nothing_heavy():
    heavy = "{'numpy', 'pydantic', 'onnxruntime', 'ciir.renderer', 'ciir.models'}"
    assert get_lines(f"print(sorted({heavy} & set(sys.modules)))") == ["[]"]
