"""What SIGTERM does, over real sockets; the signal's handler is called, as signals come to the main thread alone."""

import io
import os
import signal
import socket
import threading
from contextlib import contextmanager

import httpx2

from ciir.service.jobs.engine import Engine
from ciir.service.jobs.workers.pool import Cancelled
from ciir.service.metrics import Metrics
from ciir.service.settings import Settings
from ciir.service.web import server as server_module
from ciir.service.web.app import create_app
from ciir.service.web.server import DrainingServer
from tests.support.waiting import wait_until
from tests.support.web import ThreadPool

POST = "/v1/reconstructions"
FIELDS = {"lenses": "6x9", "model": "none"}


class Served:
    """A server in a thread."""

    def __init__(self, pool, settings, listener):
        self.pool = pool
        self.server = DrainingServer(create_app(settings, Engine(settings, Metrics(), pool)))
        self.url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        self.thread = threading.Thread(target=self.server.run, args=([listener],))
        self.thread.start()

    def terminate(self):
        self.server.handle_exit(signal.SIGTERM, None)

    def ask(self, eia, answers):
        """Posts in a thread, which puts the answer into `answers`."""
        files = {"file": ("a.png", io.BytesIO(eia))}
        asker = threading.Thread(
            target=lambda: answers.append(httpx2.post(self.url + POST, files=files, data=FIELDS, timeout=60))
        )
        asker.start()
        return asker


@contextmanager
def served(folder, **settings):
    found = Settings(folder=folder, **settings)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        one = Served(ThreadPool(found), found, listener)
        try:
            wait_until(lambda: one.server.started)
            yield one
        finally:
            one.server.should_exit = True
            one.thread.join(30)
            assert not one.thread.is_alive()


def test_what_runs_is_finished(eia, tmp_path):
    began, go = threading.Event(), threading.Event()
    answers, streams = [], []
    with served(tmp_path) as one:
        one.pool.before = lambda work, progress, cancelled: (began.set(), go.wait(30))
        asker = one.ask(eia, answers)
        assert began.wait(30)
        with httpx2.Client(base_url=one.url) as client:
            assert client.get("/readyz").status_code == 200
            id_ = next(iter(one.server._state.engine.jobs.queue.active.items())).partition(".")[0]
            follower = threading.Thread(
                target=lambda: streams.append(httpx2.get(f"{one.url}{POST}/{id_}/events", timeout=60).text)
            )
            follower.start()
            one.terminate()
            assert client.get("/readyz").status_code == 503
            assert "stopping" in client.get("/readyz").json()["detail"]
            refused = client.post(POST, files={"file": ("a.png", eia)}, data=FIELDS)
            assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
            assert client.get("/healthz").status_code == 200
            assert client.get(f"{POST}/{id_}").json()["state"] == "running"
        go.set()
        one.thread.join(30)
        assert not one.thread.is_alive()
        asker.join(30)
        follower.join(30)
    assert [answer.status_code for answer in answers] == [200]
    assert "event: running" in streams[0]


def test_what_does_not_finish_in_time_is_done_by_the_next_server(eia, tmp_path):
    began = threading.Event()
    answers = []

    def before(work, progress, cancelled):
        began.set()
        assert cancelled.wait(30)
        raise Cancelled

    with served(tmp_path, drain_seconds=0) as one:
        one.pool.before = before
        asker = one.ask(eia, answers)
        assert began.wait(30)
        one.terminate()
        one.thread.join(30)
        assert not one.thread.is_alive()
        asker.join(30)
    assert answers[0].status_code == 202
    with served(tmp_path) as one, httpx2.Client(base_url=one.url) as client:
        place = answers[0].headers["location"]
        wait_until(lambda: client.get(place).json()["state"] == "done")
        assert client.get(f"{place}/result").status_code == 200
        assert one.pool.runs == 1


def test_a_second_signal_does_not_wait(tmp_path, monkeypatch):
    killed = []
    with served(tmp_path) as one:
        monkeypatch.setattr(one.server._state.engine, "drain", threading.Event().wait)
        monkeypatch.setattr(server_module.signal, "signal", lambda *given: killed.append(given))
        monkeypatch.setattr(server_module.os, "kill", lambda *given: killed.append(given))
        one.terminate()
        assert not killed
        one.terminate()
        assert killed == [(signal.SIGTERM, signal.SIG_DFL), (os.getpid(), signal.SIGTERM)]
        monkeypatch.undo()
