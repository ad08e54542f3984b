"""The client against a real server, and against canned responses for rare cases."""

import asyncio
import io
import json

import httpx2
import numpy as np
import pytest

from ciir import errors
from ciir.errors import (
    ConnectionFailed,
    Error,
    InvalidOption,
    NotDone,
    NotFound,
    QueueFull,
    ResultExpired,
    ServiceError,
    Unauthorized,
    Unreadable,
    UnsupportedType,
)
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service import client as client_module
from ciir.service import client_messages
from ciir.service.client import AsyncClient, Client, Event, Result
from tests.support.inputs import EIA

JOB = f"/v1/reconstructions/{'0' * 32}"
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


def make_problem(status, headers=None, title="T"):
    body = {"type": "about:blank", "title": title, "status": status, "detail": "d", "instance": "/"}
    head = {"content-type": "application/problem+json"} | (headers or {})
    return httpx2.Response(status, headers=head, content=json.dumps(body))


def test_a_result(client, eia_file, tmp_path):
    result = client.reconstruct(eia_file, views="1,2", scale=None, **FIELDS)
    assert np.array_equal(decode(result.content, name="x"), EIA[1::4, 2::4])
    assert (result.format, len(result.id)) == ("png", 32)
    assert result.timings_ms["total"] > 0
    result.save(tmp_path / "view.png")
    assert (tmp_path / "view.png").read_bytes() == result.content
    result.save(tmp_path)
    assert (tmp_path / f"{result.id}.png").read_bytes() == result.content


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
    assert client.reconstruct(eia_file, views="all", format="npz", **FIELDS).content == result.content
    assert job.cancel()["state"] == "done"
    with pytest.raises(NotFound):  # it had ended, and so it was removed
        job.status()


def test_errors_are_raised_by_class(client, eia_file, tmp_path):
    (tmp_path / "notes.txt").write_bytes(b"hello")
    with pytest.raises(UnsupportedType, match=r"^upload\.txt"):
        client.reconstruct(tmp_path / "notes.txt")
    with pytest.raises(InvalidOption, match="5x9"):
        client.submit(eia_file, lenses="5x9").result()
    with pytest.raises(InvalidOption, match="lense"):
        client.submit(eia_file, lense="6x9")
    with pytest.raises(InvalidOption, match="views"):
        client.upscale(eia_file, views="all")  # not an option of that kind
    for method in ("status", "result", "cancel"):
        with pytest.raises(NotFound):
            getattr(client_module.Job(client, JOB), method)()
    with pytest.raises(Unreadable, match=r"gone\.png: No such file"):
        client.reconstruct(tmp_path / "gone.png")
    with pytest.raises(InvalidOption, match=r"^scene: no 'cup' here; give one of vase, globe, hamburger$"):
        client.reconstruct("scene:cup")
    with pytest.raises(ConnectionFailed, match=r"begins with http:// or https://$"):
        client_module.Client("localhost:8000", retries=0).models()


def test_a_shipped_scene(client):
    scene = client.reconstruct("scene:vase", lenses=(8, 6), pixels=(3, 3), model="none")
    assert decode(scene.content, name="x").shape == (8, 6, 3)


def test_the_other_kinds(client, eia_file, cube_file, tmp_path):
    height, width = EIA.shape[:2]
    large = client.upscale(eia_file, model="bicubic", scale=3)
    assert decode(large.content, name="x").shape == (3 * height, 3 * width, 3)
    eia = client.render_eia(cube_file, lenses=(6, 9), pixels=(4, 4), background=(255, 255, 255), format="tiff")
    assert (decode(eia.content, name="x").shape, eia.format) == ((24, 36, 3), "tiff")
    (tmp_path / "p.toml").write_text("panel = {pixels = [60, 40], pitch = 0.1}\nlenses = {pitch = 1, gap = 3}")
    panel = client.make_display_picture(cube_file, display=tmp_path / "p.toml", rotate=(30, 0, 0))
    assert (decode(panel.content, name="x").shape, panel.format) == ((40, 60, 3), "png")
    quilt = client.make_display_picture(eia_file, lenses=(6, 9), quilt="4x4", aspect=0.75)
    assert quilt.name == f"{quilt.id}_qs4x4a0.75.png"
    planes = client.refocus(eia_file, lenses=(6, 9), stack=(-1, 1, 3), format="npy")
    assert np.load(io.BytesIO(planes.content)).shape == (3, 6, 9, 3)
    disparity = client.disparity(eia_file, lenses=(6, 9), view=(0, 1))
    assert (disparity.content[:2], disparity.format) == (b"Pf", "pfm")
    with pytest.raises(InvalidOption, match="format: mp4 can't hold one plane"):
        client.refocus(eia_file, lenses=(6, 9), disparity=0, format="mp4")
    job = client.submit(eia_file, "upscale", model="nearest")
    assert (job.result().format, job.path) == ("png", f"/v1/upscales/{job.id}")


def test_tuples_and_folders(client, eia_file, tmp_path):
    by_text = client.reconstruct(eia_file, lenses="6x9", views="1,2;0,3", model="none", format="npz")
    by_values = client.reconstruct(eia_file, lenses=(6, 9), views=[(1, 2), (0, 3)], model="none", format="npz")
    assert by_values.id == by_text.id
    views = tmp_path / "views"
    (views / ".hidden").mkdir(parents=True)
    for v in range(4):
        for u in range(4):
            (views / f"view_{v:02d}_{u:02d}.png").write_bytes(encode_png(EIA[v::4, u::4].copy()))
    made = [client.reconstruct(views, views=(1, 2), model="none") for _ in range(2)]
    assert np.array_equal(decode(made[0].content, name="x"), EIA[1::4, 2::4])
    assert made[0].id == made[1].id  # a folder is packed to the same bytes


@pytest.mark.parametrize(
    ("status", "title", "kind"),
    [
        (401, "Unauthorized", Unauthorized),
        (404, "Not Found", NotFound),
        (409, "Not finished", NotDone),
        (409, "Cancelled", errors.Cancelled),
        (410, "Expired", ResultExpired),
        (413, "Over a limit", errors.TooLarge),
        (422, "Invalid model or scale", errors.ModelError),
        (500, "Internal error", ServiceError),
        (418, "I'm a Teapot", ServiceError),
    ],
)
def test_errors_are_those_of_the_tree(status, title, kind):
    client, requests = make_client(make_problem(status, title=title))
    with pytest.raises(Error, match=f"{status} {title}: d$" if kind is ServiceError else "^d$") as caught:
        client.models()
    assert type(caught.value) is kind
    assert len(requests) == 1


def test_a_response_of_another_server():
    client, _ = make_client(httpx2.Response(502, text="<html>"))
    with pytest.raises(ServiceError, match="not from a ciir server"):
        client.models()


@pytest.mark.parametrize(
    ("status", "title", "kind"), [(429, "Queue full", QueueFull), (503, "Not ready", errors.NotReady)]
)
def test_requests_are_repeated_after_retry_after(monkeypatch, eia_file, status, title, kind):
    slept = []
    monkeypatch.setattr(client_module.time, "sleep", slept.append)
    busy = [make_problem(status, {"retry-after": "7"}, title) for _ in range(3)]
    client, requests = make_client(*busy[:2], httpx2.Response(202, json={"events": f"{JOB}/events"}), retries=2)
    assert client.submit(eia_file).id == "0" * 32
    assert slept == [7, 7]
    bodies = [request.read().partition(b"\r\n")[2] for request in requests]
    assert all(eia_file.read_bytes() in body for body in bodies)  # the whole file is sent each time
    client, _ = make_client(*busy, retries=2)
    with pytest.raises(kind):
        client.submit(eia_file)


def test_a_get_is_repeated_only_after_retry_after(monkeypatch):
    slept = []
    monkeypatch.setattr(client_module.time, "sleep", slept.append)
    client, _ = make_client(make_problem(503, {"retry-after": "3"}), httpx2.Response(200, json=[]))
    assert (client.models(), slept) == ([], [3])
    client, requests = make_client(make_problem(503), httpx2.Response(200, json=[]))
    with pytest.raises(ServiceError):
        client.models()
    assert (len(requests), slept) == (1, [3])


def test_the_content_of_a_result_is_not_printed():
    assert (
        repr(Result("a", b"bytes", "png", {}, "a.png")) == "Result(id='a', format='png', timings_ms={}, name='a.png')"
    )


def test_the_key_is_sent():
    client, requests = make_client(httpx2.Response(200, json=[]), api_key="k")
    client.models()
    assert requests[0].headers["authorization"] == "Bearer k"


class Breaks(httpx2.SyncByteStream):
    """A stream of events that ends within the second one."""

    def __iter__(self):
        yield b': job\nretry: 1000\n\nevent: queued\ndata: {}\nid: 0\n\nevent: progress\ndata: {"stage":'
        raise httpx2.ReadError("gone")


def test_a_stream_that_breaks_once_too_often():
    broken = httpx2.Response(200, headers={"content-type": "text/event-stream"}, stream=Breaks())
    client, _ = make_client(broken, retries=0)
    events = client_module.Job(client, JOB).events()
    assert next(events) == Event(0, "queued", {})
    with pytest.raises(ConnectionFailed, match="gone; check the URL"):
        next(events)


def test_a_broken_event_stream_is_resumed(monkeypatch):
    monkeypatch.setattr(client_module.time, "sleep", lambda seconds: None)

    head = {"content-type": "text/event-stream"}
    rest = b': ping\n\nevent: running\ndata: {}\nid: 1\n\nevent: done\ndata: {"a": 1}\nid: 2\n\n'
    client, requests = make_client(
        httpx2.Response(200, headers=head, stream=Breaks()),
        make_problem(503, {"retry-after": "1"}),
        httpx2.Response(200, headers=head, content=rest),
    )
    events = list(client_module.Job(client, JOB).events())
    assert events == [Event(0, "queued", {}), Event(1, "running", {}), Event(2, "done", {"a": 1})]
    assert [request.headers.get("last-event-id") for request in requests] == [None, "0", "0"]
    client, _ = make_client(make_problem(503), make_problem(503), retries=1)
    with pytest.raises(ServiceError):
        list(client_module.Job(client, JOB).events())
    client, _ = make_client(httpx2.Response(204))
    assert list(client_module.Job(client, JOB).events()) == []


def test_a_stream_that_ends_early_is_resumed_after_a_pause(monkeypatch):
    slept = []
    monkeypatch.setattr(client_module.time, "sleep", slept.append)
    head = {"content-type": "text/event-stream"}
    client, requests = make_client(
        httpx2.Response(200, headers=head, content=b"event: queued\ndata: {}\nid: 0\n\n"),
        httpx2.Response(200, headers=head, content=b": the server stops\n\n"),
        httpx2.Response(200, headers=head, content=b"event: done\ndata: {}\nid: 1\n\n"),
    )
    assert [event.kind for event in client_module.Job(client, JOB).events()] == ["queued", "done"]
    assert (len(requests), slept) == (3, [1.0, 1.0])


def refuse(request):
    raise httpx2.ConnectError("refused")


def test_a_server_that_cannot_be_reached(monkeypatch, eia_file):
    monkeypatch.setattr(client_messages, "PAUSE_SECONDS", 0)
    client = Client("http://127.0.0.1:9")
    with pytest.raises(ConnectionFailed, match=r"^http://127\.0\.0\.1:9.*check the URL"):
        client.submit(eia_file)
    client = Client("http://server", transport=httpx2.MockTransport(refuse), retries=2)
    with pytest.raises(ConnectionFailed, match="refused"):
        list(client_module.Job(client, JOB).events())

    async def ask():
        async with AsyncClient("http://127.0.0.1:9") as client:
            await client.models()

    with pytest.raises(ConnectionFailed):
        asyncio.run(ask())


def test_the_asynchronous_client(server, eia_file, cube_file):
    async def run():
        async with AsyncClient(server) as client:
            job = await client.submit(eia_file, views="all", lenses=(6, 9), model="none", format="npz")
            kinds = [event.kind async for event in job.events()]
            results = await asyncio.gather(
                job.result(),
                client.reconstruct(eia_file, views=(1, 2), **FIELDS),
                client.upscale(eia_file, model="bicubic"),
                client.render_eia(cube_file, lenses=(6, 9), pixels=(4, 4)),
            )
            with pytest.raises(InvalidOption, match="5x9"):
                await client.reconstruct(eia_file, lenses=(5, 9))
            models = await client.models()
            return kinds, results, (await job.status())["state"], len(models), await job.cancel()

    kinds, (views, view, large, eia), state, models, last = asyncio.run(run())
    assert (kinds[0], kinds[-1], state, last["state"]) == ("queued", "done", "done", "done")
    assert np.load(io.BytesIO(views.content))["views"].shape == (16, 6, 9, 3)
    assert np.array_equal(decode(view.content, name="x"), EIA[1::4, 2::4])
    assert decode(large.content, name="x").shape == (2 * EIA.shape[0], 2 * EIA.shape[1], 3)
    assert decode(eia.content, name="x").shape == (24, 36, 3)
    assert models > 5


def test_the_asynchronous_client_repeats_requests_and_resumes_events(monkeypatch):
    monkeypatch.setattr(client_messages, "PAUSE_SECONDS", 0)
    head = {"content-type": "text/event-stream"}
    answers = [
        httpx2.Response(200, headers=head, content=b"event: queued\ndata: {}\nid: 0\n\n"),
        make_problem(503, {"retry-after": "0"}),
        httpx2.Response(200, headers=head, content=b"event: done\ndata: {}\nid: 1\n\n"),
    ]
    requests = []

    def respond(request):
        requests.append(request)
        return answers.pop(0)

    async def collect():
        async with AsyncClient("http://server", transport=httpx2.MockTransport(respond)) as client:
            return [event async for event in client_module.AsyncJob(client, JOB).events()]

    assert asyncio.run(collect()) == [Event(0, "queued", {}), Event(1, "done", {})]
    assert [request.headers.get("last-event-id") for request in requests] == [None, "0", "0"]
