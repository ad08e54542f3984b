"""The HTTP API in this process, with jobs run in its threads instead of worker processes."""

from __future__ import annotations

import os
import signal
import socket
import threading
from contextlib import contextmanager

from fastapi.testclient import TestClient

from ciir.errors import Error
from ciir.service.errors import find_response, join_lines
from ciir.service.jobs.engine import Engine
from ciir.service.jobs.job import Problem
from ciir.service.jobs.workers import task as tasks
from ciir.service.metrics import Metrics
from ciir.service.settings import Settings
from ciir.service.web.app import create_app
from ciir.service.web.server import DrainingServer
from tests.support.waiting import wait_until

POST = "/v1/reconstructions"


class ThreadPool:
    """Does the work in the calling thread."""

    def __init__(self, settings):
        self.allowed = tasks.TaskLimits.from_settings(settings)
        self.ready = True
        self.start_error = ""
        self.runs = 0
        self.outcome = None
        """Returned instead of doing the work, if it is set."""
        self.before = lambda work, progress, cancelled: None
        """Called before each piece of work."""

    def run(self, work, hooks):
        self.runs += 1
        hooks.begun(os.getpid())
        self.before(work, hooks.progress, hooks.cancelled)
        if self.outcome is not None:
            return self.outcome
        try:
            with work.source.open("rb") as source, work.target.open("w+b") as target:
                return tasks.write_result(work.request, source, target, self.allowed, lambda data: None)
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


@contextmanager
def run_app(folder, **settings):
    """Yields a client of the application with `settings`; `client.pool` does its work.

    Unlike a real server it waits a minute for a result, because on a busy machine the start of rendering alone may take
    10 s.
    """
    found = Settings(folder=folder, **{"sync_seconds": 60.0, **settings})
    pool = ThreadPool(found)
    engine = Engine(found, Metrics(), pool if found.workers else None)
    with TestClient(create_app(found, engine), raise_server_exceptions=False) as client:
        client.pool, client.engine = pool, engine
        yield client


class ServerThread:
    """A server in a thread."""

    def __init__(self, pool, settings, listener):
        self.pool = pool
        self.uvicorn = DrainingServer(create_app(settings, Engine(settings, Metrics(), pool)))
        self.url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        self.thread = threading.Thread(target=self.uvicorn.run, args=([listener],))
        self.thread.start()

    def terminate(self):
        self.uvicorn.handle_exit(signal.SIGTERM, None)


@contextmanager
def serve_app(folder, **settings):
    """Serves the application with `settings` on a port of this machine, in a thread of this process."""
    found = Settings(folder=folder, **settings)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = ServerThread(ThreadPool(found), found, listener)
        try:
            wait_until(lambda: server.uvicorn.started)
            yield server
        finally:
            server.uvicorn.should_exit = True
            server.thread.join(30)
            assert not server.thread.is_alive()


def check_problem(response, status, *parts):
    """Checks that `response` is a problem with this status whose `detail` contains `parts`. Returns `detail`."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = response.json()
    assert set(body) == {"type", "title", "status", "detail", "instance"}
    assert body["status"] == status
    assert body["instance"] == response.request.url.path
    assert body["type"] == "about:blank" or body["type"].startswith("urn:ciir:")
    assert body["title"]
    assert "\n" not in body["detail"]
    for part in parts:
        assert part in body["detail"]
    return body["detail"]


def post_file(client, name="eia.png", data=b"", headers=None, **fields):
    """Posts one file for reconstruction with the form's `fields`, and returns the response."""
    return client.post(POST, files={"file": (name, data)}, data=fields, headers=headers)
