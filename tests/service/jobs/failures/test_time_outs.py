"""Jobs over CIIR_JOB_SECONDS: refused after two time-outs, and not after one beside another failure."""

import os
import signal

import pytest
from fastapi.testclient import TestClient

from ciir.service.jobs.job import FINAL
from ciir.service.jobs.workers import pool, worker
from ciir.service.settings import Settings
from ciir.service.web.app import create_app
from tests.support.inputs import CUBE
from tests.support.servers import find_workers
from tests.support.waiting import wait_until
from tests.support.web import check_problem, post_file
from tests.support.workers.pools import COLD, LONG


@pytest.fixture
def client(tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "MODULE", COLD)
    monkeypatch.setattr(pool, "WORKING_SHARE", 0.0)  # other processes may keep this machine busy
    settings = Settings(folder=tmp_path / "service", workers=1, job_seconds=1.0)
    with TestClient(create_app(settings)) as client:
        wait_until(lambda: client.get("/readyz").status_code == 200)
        yield client


def post(client, **headers):
    return post_file(client, "cube.off", CUBE, headers, **LONG)


def wait_for_end(client, place):
    return wait_until(lambda: (status := client.get(place).json())["state"] in FINAL and status)


def test_a_job_that_timed_out_twice_is_refused(client):
    place = post(client, Prefer="respond-async").headers["location"]
    status = wait_for_end(client, place)
    assert (status["state"], status["attempts"]) == ("failed", 2)
    check_problem(post(client), 422, "not done after 1 s, twice")
    assert client.get(place).json() == status  # the refusal stands


def test_a_killed_worker_and_one_time_out_are_no_refusal(client):
    workers = client.app.state.service.engine._pool
    workers._seconds = 60
    place = post(client, Prefer="respond-async").headers["location"]
    wait_until(lambda: client.get(place).json()["progress"])  # a worker has received it
    workers._seconds = 1
    os.kill(find_workers(os.getpid(), COLD)[0], signal.SIGKILL)
    status = wait_for_end(client, place)
    assert (status["attempts"], status["problem"]["status"]) == (2, 503)
    assert post(client, Prefer="respond-async").json()["attempts"] < 2  # not the failed job, but a new one
