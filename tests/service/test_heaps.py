import platform
import sys

import pytest

from tests.support.servers import run_python

COUNT = """
import ctypes, threading
from ciir.service.heaps import limit_heaps

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
