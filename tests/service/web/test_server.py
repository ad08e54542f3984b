"""SIGTERM, over real sockets. The handler is called directly, as only the main thread receives signals."""

import io
import json
import os
import signal
import socket
import threading

import httpx2
import pytest

from ciir.service.jobs.workers.pool import Cancelled
from ciir.service.web import server as server_module
from ciir.service.web.connections import AcceptErrors
from ciir.service.web.middleware import protocol
from tests.support.waiting import wait_until
from tests.support.web import serve_app

POST = "/v1/reconstructions"
FIELDS = {"lenses": "6x9", "model": "none"}


def post(server, eia, responses):
    """Posts in a thread that adds the response to `responses`."""
    files = {"file": ("a.png", io.BytesIO(eia))}
    poster = threading.Thread(
        target=lambda: responses.append(httpx2.post(server.url + POST, files=files, data=FIELDS, timeout=60))
    )
    poster.start()
    return poster


def test_its_loop_logs_errors_of_accepting_once_a_second(tmp_path):
    with serve_app(tmp_path) as server:
        assert isinstance(server.uvicorn._loop.get_exception_handler(), AcceptErrors)


def test_running_jobs_are_finished(eia, tmp_path):
    started, go = threading.Event(), threading.Event()
    responses, streams = [], []
    with serve_app(tmp_path) as server:
        server.pool.before = lambda work, progress, cancelled: (started.set(), go.wait(30))
        poster = post(server, eia, responses)
        assert started.wait(30)
        with httpx2.Client(base_url=server.url) as client:
            assert client.get("/readyz").status_code == 200
            id_ = next(iter(server.uvicorn._state.engine.jobs.queue.active.items())).partition(".")[0]
            follower = threading.Thread(
                target=lambda: streams.append(httpx2.get(f"{server.url}{POST}/{id_}/events", timeout=60).text)
            )
            follower.start()
            server.terminate()
            assert client.get("/readyz").status_code == 503
            assert "stopping" in client.get("/readyz").json()["detail"]
            refused = client.post(POST, files={"file": ("a.png", eia)}, data=FIELDS)
            assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
            assert client.get("/healthz").status_code == 200
            assert client.get(f"{POST}/{id_}").json()["state"] == "running"
        go.set()
        server.thread.join(30)
        assert not server.thread.is_alive()
        poster.join(30)
        follower.join(30)
    assert [response.status_code for response in responses] == [200]
    assert "event: running" in streams[0]


def test_unfinished_jobs_are_done_by_the_next_server(eia, tmp_path):
    started = threading.Event()
    responses = []

    def before(work, progress, cancelled):
        started.set()
        assert cancelled.wait(30)
        raise Cancelled

    with serve_app(tmp_path, drain_seconds=0) as server:
        server.pool.before = before
        poster = post(server, eia, responses)
        assert started.wait(30)
        server.terminate()
        server.thread.join(30)
        assert not server.thread.is_alive()
        poster.join(30)
    assert responses[0].status_code == 202
    with serve_app(tmp_path) as server, httpx2.Client(base_url=server.url) as client:
        place = responses[0].headers["location"]
        wait_until(lambda: client.get(place).json()["state"] == "done")
        assert client.get(f"{place}/result").status_code == 200
        assert server.pool.runs == 1


def connect(url):
    return socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])), timeout=30)


FORM = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.off"\r\n\r\nOFF\r\n--b--\r\n'
HEAD = "POST /v1/files HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; boundary=b\r\nX-Request-Id: mine\r\n"


@pytest.mark.parametrize(("rest", "status"), [(b"", 503), (FORM[9:], 201)], ids=str)
def test_an_upload_that_is_complete_soon_is_accepted(tmp_path, caplog, monkeypatch, rest, status):
    monkeypatch.setattr(protocol, "UPLOAD_SECONDS", 0.5)
    with serve_app(tmp_path) as server, connect(server.url) as upload:
        upload.sendall(f"{HEAD}Content-Length: {len(FORM)}\r\nExpect: 100-continue\r\n\r\n".encode())
        assert upload.recv(65536).startswith(b"HTTP/1.1 100")
        upload.sendall(FORM[:9])
        server.terminate()
        assert server.uvicorn._draining is not None
        server.uvicorn._draining.join(30)
        upload.sendall(rest)
        head, _, body = b"".join(iter(lambda: upload.recv(65536), b"")).decode().partition("\r\n\r\n")
    assert head.startswith(f"HTTP/1.1 {status}")
    assert "\r\nx-request-id: mine" in head
    if status == 503:
        assert {"retry-after: 1", "connection: close"} <= set(head.split("\r\n"))
        assert json.loads(body)["type"] == "urn:ciir:not-ready"
    assert [record for record in caplog.records if record.levelname == "ERROR"] == []


def test_a_second_signal_kills(tmp_path, monkeypatch):
    killed = []
    with serve_app(tmp_path) as server:
        monkeypatch.setattr(server.uvicorn._state.engine, "drain", threading.Event().wait)
        monkeypatch.setattr(server_module.signal, "signal", lambda *given: killed.append(given))
        monkeypatch.setattr(server_module.os, "kill", lambda *given: killed.append(given))
        server.terminate()
        assert not killed
        server.terminate()
        assert killed == [(signal.SIGTERM, signal.SIG_DFL), (os.getpid(), signal.SIGTERM)]
        monkeypatch.undo()
