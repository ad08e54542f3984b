"""A server in this process, whose work is done in its threads in place of worker processes."""

from __future__ import annotations

import json
import time
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import pytest
from fastapi.testclient import TestClient

from ciir.errors import Error
from ciir.service.errors import find_response, join_lines
from ciir.service.jobs.engine import Engine
from ciir.service.jobs.job import Problem
from ciir.service.jobs.workers import task as tasks
from ciir.service.metrics import Metrics
from ciir.service.settings import Settings
from ciir.service.web.app import create_app


class ThreadPool:
    """Does the work where it is asked to."""

    def __init__(self, settings):
        self.allowed = tasks.TaskLimits.from_settings(settings)
        self.ready = True
        self.runs = 0
        self.before = lambda work, progress, cancelled: None
        """Called before each piece of work."""

    def run(self, work, *, progress, cancelled):
        self.runs += 1
        self.before(work, progress, cancelled)
        try:
            made = tasks.reconstruct(work, self.allowed)
            return replace(made, report=json.loads(work.report.read_bytes()))
        except Error as error:
            response = find_response(error)
            return Problem(response.status, response.title, join_lines(str(error)))

    def start(self):
        pass

    def count_ready(self):
        return 2

    def is_ready(self):
        return self.ready

    def close(self):
        self.ready = False


def until(holds, seconds=30):
    """Asks again and again, but not for ever."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, f"still not so after {seconds} s"
        time.sleep(0.01)


@contextmanager
def running(folder, **settings):
    """A client of a server with `settings`; `client.pool` does its work."""
    found = Settings(folder=folder, **settings)
    pool = ThreadPool(found)
    engine = Engine(found, Metrics(), pool if found.workers else None)
    with TestClient(create_app(found, engine), raise_server_exceptions=False) as client:
        client.pool, client.engine = pool, engine
        yield client


def problem(response, status, *words):
    """Checks the one shape of errors; returns `detail`."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = response.json()
    assert set(body) == {"type", "title", "status", "detail", "instance"}
    assert body["status"] == status
    assert body["instance"] == response.request.url.path
    assert body["type"] == "about:blank" or body["type"].startswith("urn:ciir:")
    assert body["title"]
    assert "\n" not in body["detail"]
    for word in words:
        assert word in body["detail"]
    return body["detail"]


def send(client, name="eia.png", data=b"", headers=None, **fields):
    return client.post("/v1/reconstructions", files={"file": (name, data)}, data=fields, headers=headers)


@pytest.fixture(scope="session")
def web():
    """What test modules, which can't import this one, use of it."""
    return SimpleNamespace(ThreadPool=ThreadPool, running=running, problem=problem, send=send, until=until)


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with running(tmp_path_factory.mktemp("service")) as client:
        yield client


@pytest.fixture
def eia(samples):
    return samples.encode_png(samples.EIA)
