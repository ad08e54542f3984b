"""The client against a real server, and against canned responses for rare cases."""

import io
import json

import httpx2
import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service import client as client_module
from ciir.service.client import (
    Client,
    Event,
    InvalidInput,
    NotDone,
    NotFound,
    QueueFull,
    ServiceError,
    Unauthorized,
    Unavailable,
)
from tests.support.inputs import EIA

FIELDS = {"lenses": "6x9", "model": "none"}


@pytest.fixture
def client(server):
    with Client(server) as client:
        yield client


def make_client(*responses, **options):
    """A client that gets `responses`, one after another, and the list of its requests."""
    requests, remaining = [], list(responses)

    def respond(request):
        requests.append(request)
        return remaining.pop(0)

    return Client("http://server", transport=httpx2.MockTransport(respond), **options), requests


def make_problem(status, headers=None):
    body = {"type": "about:blank", "title": "T", "status": status, "detail": "d", "instance": "/"}
    head = {"content-type": "application/problem+json"} | (headers or {})
    return httpx2.Response(status, headers=head, content=json.dumps(body))


def test_a_result(client, eia_file, tmp_path):
    result = client.reconstruct(eia_file, views="1,2", scale=None, **FIELDS)
    assert np.array_equal(decode(result.content, name="x"), EIA[1::4, 2::4])
    assert (result.format, len(result.id)) == ("png", 32)
    assert result.timings_ms["total"] > 0
    result.save(tmp_path / "view.png")
    assert (tmp_path / "view.png").read_bytes() == result.content


def test_a_job(client, eia_file):
    job = client.submit(eia_file, views="all", format="npz", **FIELDS)
    events = list(job.events())
    assert [event.number for event in events] == list(range(len(events)))
    assert (events[0].kind, events[-1].kind) == ("queued", "done")
    result = job.result()
    assert (result.id, result.format) == (job.id, "npz")
    assert np.load(io.BytesIO(result.content))["views"].shape == (16, 6, 9, 3)
    assert job.status()["state"] == "done"
    assert job.status()["report"]["plan"]["model"] == "none"
    assert job.cancel()["state"] == "done"
    assert client.reconstruct(eia_file, views="all", format="npz", **FIELDS).content == result.content


def test_errors_are_raised_by_class(client, eia_file, tmp_path):
    (tmp_path / "notes.txt").write_bytes(b"hello")
    with pytest.raises(InvalidInput, match=r"415 .*upload\.txt") as caught:
        client.reconstruct(tmp_path / "notes.txt")
    assert (caught.value.status, caught.value.title) == (415, "Type not supported")
    with pytest.raises(InvalidInput, match="5x9"):
        client.submit(eia_file, lenses="5x9").result()
    with pytest.raises(InvalidInput, match="lense"):
        client.submit(eia_file, lense="6x9")
    for method in ("status", "result", "cancel"):
        with pytest.raises(NotFound):
            getattr(client_module.Job(client, "0" * 32), method)()
    with pytest.raises(FileNotFoundError):
        client.reconstruct(tmp_path / "gone.png")


@pytest.mark.parametrize(
    ("status", "kind"), [(401, Unauthorized), (409, NotDone), (410, NotFound), (500, ServiceError), (418, ServiceError)]
)
def test_other_errors(status, kind):
    client, requests = make_client(make_problem(status))
    with pytest.raises(kind, match=f"{status} T: d"):
        client.models()
    assert len(requests) == 1


def test_a_response_of_another_server():
    client, _ = make_client(httpx2.Response(502, text="<html>"))
    with pytest.raises(ServiceError, match="not from a ciir server"):
        client.models()


@pytest.mark.parametrize(("status", "kind"), [(429, QueueFull), (503, Unavailable)])
def test_requests_are_repeated_after_retry_after(monkeypatch, eia_file, status, kind):
    slept = []
    monkeypatch.setattr(client_module.time, "sleep", slept.append)
    busy = [make_problem(status, {"retry-after": "7"}) for _ in range(3)]
    client, requests = make_client(*busy[:2], httpx2.Response(202, json={"id": "0" * 32}), retries=2)
    assert client.submit(eia_file).id == "0" * 32
    assert slept == [7, 7]
    bodies = [request.read().partition(b"\r\n")[2] for request in requests]
    assert all(eia_file.read_bytes() in body for body in bodies)  # the whole file is sent each time
    client, _ = make_client(*busy, retries=2)
    with pytest.raises(kind) as caught:
        client.submit(eia_file)
    assert caught.value.retry_after == 7


def test_the_key_is_sent():
    client, requests = make_client(httpx2.Response(200, json=[]), api_key="k")
    client.models()
    assert requests[0].headers["authorization"] == "Bearer k"


def test_a_broken_event_stream_is_resumed(monkeypatch):
    monkeypatch.setattr(client_module.time, "sleep", lambda seconds: None)

    class Breaks(httpx2.SyncByteStream):
        def __iter__(self):
            yield b': job\nretry: 1000\n\nevent: queued\ndata: {}\nid: 0\n\nevent: progress\ndata: {"stage":'
            raise httpx2.ReadError("gone")

    head = {"content-type": "text/event-stream"}
    rest = b': ping\n\nevent: running\ndata: {}\nid: 1\n\nevent: done\ndata: {"a": 1}\nid: 2\n\n'
    client, requests = make_client(
        httpx2.Response(200, headers=head, stream=Breaks()),
        make_problem(503),
        httpx2.Response(200, headers=head, content=rest),
    )
    events = list(client_module.Job(client, "0" * 32).events())
    assert events == [Event(0, "queued", {}), Event(1, "running", {}), Event(2, "done", {"a": 1})]
    assert [request.headers.get("last-event-id") for request in requests] == [None, "0", "0"]
    client, _ = make_client(make_problem(503), make_problem(503), retries=1)
    with pytest.raises(Unavailable):
        list(client_module.Job(client, "0" * 32).events())
    client, _ = make_client(httpx2.Response(204))
    assert list(client_module.Job(client, "0" * 32).events()) == []


def test_a_stream_that_ends_early_is_resumed_after_a_pause(monkeypatch):
    slept = []
    monkeypatch.setattr(client_module.time, "sleep", slept.append)
    head = {"content-type": "text/event-stream"}
    client, requests = make_client(
        httpx2.Response(200, headers=head, content=b"event: queued\ndata: {}\nid: 0\n\n"),
        httpx2.Response(200, headers=head, content=b": the server stops\n\n"),
        httpx2.Response(200, headers=head, content=b"event: done\ndata: {}\nid: 1\n\n"),
    )
    assert [event.kind for event in client_module.Job(client, "0" * 32).events()] == ["queued", "done"]
    assert (len(requests), slept) == (3, [1.0, 1.0])
