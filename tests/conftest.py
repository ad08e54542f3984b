"""Settings of all tests: one thread for linear algebra, Ctrl-C, the same examples each time, slow tests on request, and
a list of skipped tests."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Set before numpy and torch are loaded, and inherited by the processes that tests start. On busy cores their threads
# wait for one another: a calibration took 5.2 s of processor time instead of 0.4.
assert not {"numpy", "torch"} & set(sys.modules), "a plugin of pytest has loaded them"
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

# A shell without job control makes its background processes ignore Ctrl-C, which tests send.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("ciir", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("ciir")


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="run the tests that are marked slow too")
    parser.addoption("--list-skipped", type=Path, metavar="FILE", help="write the names of skipped tests to FILE")


def pytest_collection_modifyitems(config, items):
    if not config.getoption("--slow"):
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="slow; make test-slow runs it"))


def pytest_terminal_summary(terminalreporter, config):
    if path := config.getoption("--list-skipped"):
        names = dict.fromkeys(report.nodeid for report in terminalreporter.getreports("skipped"))
        path.write_text("".join(f"{name}\n" for name in names))
