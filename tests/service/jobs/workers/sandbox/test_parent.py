"""What protects a parent of worker processes; `test_compromised` attacks it."""

import platform
import subprocess
import sys

import pytest

from tests.support.paths import ROOT

CODE = """
import ctypes
from ciir.service.jobs.workers.sandbox import parent
libc = ctypes.CDLL(None)
print(libc.prctl(3, 0, 0, 0, 0))  # PR_GET_DUMPABLE
parent.protect(())
print(libc.prctl(3, 0, 0, 0, 0))
"""


@pytest.mark.skipif(platform.system() != "Linux", reason="prctl is Linux's")
def test_processes_of_its_user_cannot_read_its_memory():
    command = [sys.executable, "-c", CODE]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=60, check=True)  # noqa: S603
    assert done.stdout.split() == ["1", "0"]
