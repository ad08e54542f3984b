"""A batch on worker processes, one of which is killed, and which Ctrl-C stops."""

import json
import os
import re
import signal
import subprocess
import sys

import psutil
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.pictures import encode_png
from tests.support.light_fields import make_views
from tests.support.waiting import wait_until

pytestmark = pytest.mark.slow

INPUTS = 12
OPTIONS = ("--lenses", "40x40", "--pixels", "5x5", "--model", "quality", "--views", "all", "--workers", "1")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "in").mkdir()
    for seed in range(INPUTS):
        array = LightField(make_views((5, 5), side=40, channels=3, seed=seed)).eia()
        (tmp_path / "in" / f"{seed}.png").write_bytes(encode_png(array))
    return tmp_path


def start(folder):
    # A shell's background processes ignore SIGINT, and so would the command.
    command = ["/usr/bin/env", "--default-signal=INT", sys.executable, "-m", "ciir", "batch", folder / "in"]
    command += ["-o", folder / "out", *OPTIONS]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, process_group=0)  # noqa: S603 - our own


def press_ctrl_c(process):
    """As a terminal does: its workers get the signal too."""
    os.killpg(process.pid, signal.SIGINT)


def count_outputs(folder):
    return sum(1 for path in (folder / "out").glob("*/report.json"))


def find_worker(process):
    """The worker is a child of the fork server, whose parent is the command."""
    found = [worker for each in psutil.Process(process.pid).children() for worker in each.children()]
    return found[0] if found else None


def test_a_worker_is_killed_and_ctrl_c_stops_the_batch_which_then_goes_on(folder):
    with start(folder) as process:
        wait_until(lambda: count_outputs(folder) >= 1)
        killed = find_worker(process)
        killed.kill()
        wait_until(lambda: (new := find_worker(process)) and new.pid != killed.pid and count_outputs(folder) >= 3)
        press_ctrl_c(process)
        errors = process.communicate(timeout=60)[1]
    first = json.loads((folder / "out" / "summary.json").read_bytes())
    assert first["done"] == count_outputs(folder) >= 3
    assert first["not_done"] >= 1
    assert (process.returncode, errors.splitlines()[-1]) == (130, "ciir: interrupted")
    assert f"out: {first['done']} of {INPUTS} inputs done" in errors.splitlines()[-2]
    assert errors.splitlines()[-2].endswith("; the same command continues")
    assert first["done"] + first["not_done"] == INPUTS
    assert not (folder / "out" / ".batch" / "scratch").exists()
    with start(folder) as process:
        errors = process.communicate(timeout=60)[1]
    unexpected = [line for line in errors.splitlines() if not re.match(r"ciir: \d+ of \d+ done, ", line)]
    assert (process.returncode, unexpected) == (0, [])  # a slow machine shows progress
    second = json.loads((folder / "out" / "summary.json").read_bytes())
    assert second["kept"] >= first["done"]
    assert second["kept"] + second["done"] == INPUTS == count_outputs(folder)


def test_ctrl_c_while_the_workers_start(folder):
    with start(folder) as process:
        wait_until(lambda: find_worker(process))
        press_ctrl_c(process)
        errors = process.communicate(timeout=60)[1]
    lines = errors.splitlines()
    assert (process.returncode, len(lines), lines[-1]) == (130, 2, "ciir: interrupted")
    assert f"out: 0 of {INPUTS} inputs done" in lines[0]
    summary = json.loads((folder / "out" / "summary.json").read_bytes())
    assert summary["not_done"] == INPUTS
