"""Fixtures for all tests of jobs."""

import shutil

import pytest

from ciir.service.jobs.queue import Queue
from tests.support.jobs import JobService, RedisServer, StandInPool


@pytest.fixture
def redis_server():
    if shutil.which("redis-server") is None:
        pytest.skip("no redis-server here; Debian's package of that name has it")
    server = RedisServer()
    server.start()
    yield server
    server.close()


@pytest.fixture(params=["sqlite", "redis"])
def queue_url(request):
    return request.getfixturevalue("redis_server").url if request.param == "redis" else ""


@pytest.fixture
def queue(queue_url, tmp_path):
    queue = Queue(tmp_path, queue_url)
    yield queue
    queue.close()


@pytest.fixture
def service(tmp_path):
    service = JobService(tmp_path / "service")
    yield service
    service.close()


@pytest.fixture
def jobs(service):
    return service.open_jobs()


@pytest.fixture
def pool():
    return StandInPool()
