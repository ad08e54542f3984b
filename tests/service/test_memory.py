import platform
import sys

import pytest

from ciir.service import memory
from tests.support.servers import run_python

COUNT = """
import ctypes, threading
from ciir.service.memory import limit_heaps

limit_heaps({most})
libc, together = ctypes.CDLL(None), threading.Barrier(10)
libc.malloc.restype = ctypes.c_void_p

def allocate():
    together.wait()
    libc.malloc(100)
    together.wait()

threads = [threading.Thread(target=allocate) for _ in range(10)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
libc.malloc_info(0, ctypes.c_void_p.in_dll(libc, "stdout"))
libc.fflush(None)
"""


@pytest.mark.skipif(sys.platform != "linux" or platform.libc_ver()[0] != "glibc", reason="the heaps of glibc")
@pytest.mark.parametrize("most", [2, 4])
def test_threads_share_heaps(most):
    done = run_python("-c", COUNT.format(most=most))
    assert done.stdout.count("<heap nr=") == most, done.stderr


@pytest.mark.parametrize(
    ("mode", "committed", "lacks"), [(0, 7, False), (1, 7, False), (2, 4, False), (2, 5, False), (2, 6, True)]
)
def test_a_system_that_promises_only_what_it_has_may_lack_memory(tmp_path, monkeypatch, mode, committed, lacks):
    (tmp_path / "sys/vm").mkdir(parents=True)
    (tmp_path / "sys/vm/overcommit_memory").write_text(f"{mode}\n")
    lines = ("MemTotal:  99 kB", "CommitLimit:  8 kB", f"Committed_AS: {committed} kB", "HugePages_Total: 0")
    (tmp_path / "meminfo").write_text("\n".join(lines))
    monkeypatch.setattr(memory, "SYSTEM", tmp_path)
    assert memory.may_lack(3 * 1024) == lacks


def test_other_systems_do_not_lack_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "SYSTEM", tmp_path)
    assert not memory.may_lack(2**60)


def test_this_system_is_read():
    assert isinstance(memory.may_lack(2**40), bool)
