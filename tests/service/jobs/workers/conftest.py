"""Fixtures for pools and tasks."""

import os

import pytest

from ciir.service.jobs.job import Request
from ciir.service.jobs.workers import consumer
from ciir.service.jobs.workers import worker as worker_module
from ciir.service.jobs.workers.pool import Pool
from ciir.service.jobs.workers.task import Task
from ciir.service.settings import Settings
from tests.support.inputs import CUBE_OBJ
from tests.support.servers import find_workers
from tests.support.workers.pools import COLD


@pytest.fixture
def open_pool(monkeypatch):
    """Opens pools of one worker without warm-up, and closes them at the end."""
    monkeypatch.setattr(worker_module, "MODULE", COLD)
    pools = []

    def make(**settings):
        pools.append(Pool(Settings(**{"workers": 1} | settings)))
        return pools[-1]

    yield make
    for pool in pools:
        pool.close()
    assert find_workers(os.getpid(), COLD) == []


@pytest.fixture
def retries_at_once(monkeypatch):
    monkeypatch.setattr(consumer, "RETRY_SECONDS", 0.01)


@pytest.fixture
def make_task(tmp_path):
    (tmp_path / "input").write_bytes(CUBE_OBJ)

    def make(options, form=None, name="upload.obj"):
        folder = tmp_path / f"run {len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        return Task("an id", Request(name, options, form), tmp_path / "input", folder / "result")

    return make
