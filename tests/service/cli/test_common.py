"""The progress bar, on pseudo-terminals."""

import fcntl
import io
import os
import pty
import struct
import sys
import termios
import time
from contextlib import ExitStack
from select import select

import pytest

from ciir.service.cli import common


@pytest.fixture
def terminal(monkeypatch):
    """Makes standard error a terminal of the given size. Returns a function that reads what was shown."""
    stack = ExitStack()

    def open_terminal(rows, columns):
        outer, inner = pty.openpty()
        fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        file = stack.enter_context(os.fdopen(inner, "w", encoding="utf-8"))
        stack.callback(os.close, outer)
        monkeypatch.setattr(sys, "stderr", file)
        monkeypatch.setattr(common, "BAR_DELAY", 0.05)
        monkeypatch.setattr(common, "BAR_INTERVAL", 0.05)

        def read():
            file.flush()
            return os.read(outer, 65536).decode() if select([outer], [], [], 1)[0] else ""

        return read

    with stack:
        yield open_terminal


def wait_for(read, text):
    shown, end = "", time.monotonic() + 10
    while text not in shown:
        assert time.monotonic() < end, shown
        shown += read()
    return shown


@pytest.mark.parametrize("size", [(24, 70), (0, 0)])
def test_a_bar_is_shown_before_anything_is_finished_and_cleared(terminal, size):
    """Also on a terminal that states no size."""
    read = terminal(*size)
    with common.progress_bar("view") as progress:
        wait_for(read, "0view [00:00")
        progress(0, 4)
        wait_for(read, "0/4 [")
        progress(1, 4)
        shown = wait_for(read, "1/4 [")
        assert "<" in shown  # the time left
        assert max(map(len, shown.split("\r"))) <= (size[1] or 80)
    wait_for(read, "   \r")


def test_the_time_on_a_bar_passes_while_nothing_is_finished(terminal):
    read = terminal(24, 70)
    with common.progress_bar("view") as progress:
        progress(0, 1)
        wait_for(read, "0/1 [00:01")
    wait_for(read, "   \r")  # cleared


def test_short_work_shows_no_bar(terminal, monkeypatch):
    read = terminal(24, 70)
    monkeypatch.setattr(common, "BAR_DELAY", 60)
    with common.progress_bar("view") as progress:
        progress(0, 2)
        progress(2, 2)
    print("done", end="", file=sys.stderr)
    assert wait_for(read, "done") == "done"


def test_no_bar_is_shown_in_a_pipe(monkeypatch):
    file = io.StringIO()
    monkeypatch.setattr(sys, "stderr", file)
    monkeypatch.setattr(common, "BAR_DELAY", 0)
    with common.progress_bar("view") as progress:
        progress(1, 2)
    assert file.getvalue() == ""
