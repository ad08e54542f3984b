"""The clients against canned responses: errors, streams that break, requests that are repeated."""

import asyncio
import json
import re

import httpx2
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
)
from ciir.service import client as client_module
from ciir.service import client_messages
from ciir.service.client import AsyncClient, Client, Event, Result

JOB = f"/v1/reconstructions/{'0' * 32}"


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


PROBLEM = {"content-type": "application/problem+json"}
HEADERS = {"content-disposition": 'attachment; filename="1.png"', "etag": '"1"'}
FOREIGN = {
    "a web page": (200, {"html": "<html>"}),
    "another file": (200, {"headers": HEADERS | {"content-disposition": 'attachment; filename="1.exe"'}}),
    "no id": (200, {"headers": {"content-disposition": 'attachment; filename="1.png"'}}),
    "other times": (200, {"headers": HEADERS | {"server-timing": "cache;desc=hit"}}),
    "other notes": (200, {"headers": HEADERS | {"x-notes": "1"}}),
    "an object": (202, {"json": {}}),
    "a list": (202, {"json": []}),
    "a job elsewhere": (202, {"json": {"events": f"http://other{JOB}/events"}}),
    "text": (202, {"text": "ok"}),
    "a broken problem": (500, {"headers": PROBLEM, "text": "{"}),
    "a problem without a title": (404, {"headers": PROBLEM, "text": "{}"}),
    "a problem that is a list": (404, {"headers": PROBLEM, "text": "[]"}),
    "a redirection": (302, {"headers": {"location": "/login"}}),
}


@pytest.mark.parametrize(("status", "content"), FOREIGN.values(), ids=FOREIGN)
@pytest.mark.parametrize("transport", [Client, AsyncClient])
@pytest.mark.parametrize("name", ["reconstruct", "inspect", "submit", "models"])
def test_whatever_another_server_answers_is_a_service_error(status, content, transport, name):
    if name == "models" and content == {"json": []}:
        return  # no model at all

    def respond(request):
        return httpx2.Response(status, **content)

    async def ask():
        client = transport("http://server", transport=httpx2.MockTransport(respond), retries=0)
        found = getattr(client, name)(*([] if name == "models" else ["scene:vase"]))
        return await found if transport is AsyncClient else found

    with pytest.raises(ServiceError, match="not from a ciir server; check the URL"):
        asyncio.run(ask())


@pytest.mark.parametrize("sent", [[], {}, {"events": 1}, "done", None])
def test_a_status_of_another_server(sent):
    for act in ("status", "cancel"):
        client, _ = make_client(httpx2.Response(200, json=sent))
        with pytest.raises(ServiceError, match=r"^200: the response is not from a ciir server"):
            getattr(client.job("0" * 32), act)()


@pytest.mark.parametrize("lines", ["event: done\ndata: {}\n\n", "id: 0\ndata: [\n\n", "id: 0\ndata: 1\n\n"])
def test_events_of_another_server(lines):
    client, _ = make_client(httpx2.Response(200, headers={"content-type": "text/event-stream"}, text=lines))
    with pytest.raises(ServiceError, match=r"^event stream: the response is not from a ciir server"):
        list(client.job("0" * 32).events())


def test_options_of_other_operations_are_refused_before_anything_is_sent():
    client, requests = make_client()
    with pytest.raises(errors.InvalidOption, match="'foo': no such option; the options are ") as caught:
        client.upscale("a.png", foo=1)
    assert str(caught.value).endswith("the options are model, scale, skip")
    with pytest.raises(errors.InvalidOption, match="'calibration', 'stack': no such option"):
        client.reconstruct("a.png", stack="-1:0:9", calibration="missing.json")
    assert requests == []


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
    with pytest.raises(kind) as raised:
        client.submit(eia_file)
    assert str(raised.value) == "d"  # the detail


def test_a_get_is_repeated_only_after_retry_after(monkeypatch):
    slept = []
    monkeypatch.setattr(client_module.time, "sleep", slept.append)
    client, _ = make_client(make_problem(503, {"retry-after": "3"}), httpx2.Response(200, json=[]))
    assert (client.models(), slept) == ([], [3])
    client, requests = make_client(make_problem(503), httpx2.Response(200, json=[]))
    with pytest.raises(ServiceError):
        client.models()
    assert (len(requests), slept) == (1, [3])


def test_the_server_answers_before_the_time_out(eia_file):
    result = {"etag": '"1"', "content-disposition": 'attachment; filename="1.png"'}
    for transport in (Client, AsyncClient):
        requests = []

        def respond(request, requests=requests):
            requests.append(request)
            return httpx2.Response(200, headers=result)

        client = transport("http://server", transport=httpx2.MockTransport(respond))
        made = client.reconstruct(eia_file)
        assert (asyncio.run(made) if transport is AsyncClient else made).format == "png"
        name, _, seconds = requests[0].headers["prefer"].partition("=")
        assert name == "wait"
        assert 10 <= int(seconds) <= client_module.TIMEOUT_SECONDS / 2


@pytest.mark.parametrize("key", ["k", "k\n", " k\r\n", "\u00fc"])
def test_the_key_is_sent_as_the_server_reads_its_own(key):
    client, requests = make_client(httpx2.Response(200, json=[]), api_key=key)
    client.models()
    assert dict(requests[0].headers.raw)[b"Authorization"] == f"Bearer {key.strip()}".encode()


@pytest.mark.parametrize("kind", [Client, AsyncClient])
def test_a_key_that_no_header_can_hold_is_refused_and_not_shown(kind):
    with pytest.raises(InvalidOption, match=r"^api_key: .* give one of the server's keys$") as caught:
        kind("http://server", api_key="first\nsecond")
    assert "first" not in str(caught.value)


@pytest.mark.parametrize("key", ["", " \n"])
def test_an_empty_key_is_refused(key):
    with pytest.raises(
        InvalidOption, match=r"^api_key: is empty; give one of the server's keys, or None if it has none$"
    ):
        Client("http://server", api_key=key)


@pytest.mark.parametrize("kind", ["reconstructions", "view"])
def test_a_kind_that_there_is_not(kind):
    """The paths of HTTP have the plural."""
    client, _ = make_client()
    expected = f"^kind: no '{kind}' here; give one of reconstruction, upscale, .*, inspection$"
    with pytest.raises(InvalidOption, match=expected):
        client.submit("scene:vase", kind)
    with pytest.raises(InvalidOption, match=expected):
        client.job("0" * 32, kind)


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
    with pytest.raises(ConnectionFailed, match=f"^http://server{JOB}: gone; go on with client.job"):
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


PAUSES = [1.0, 2.0, 4.0, 8.0, 15.0, 15.0, 15.0]
"""Pauses until a client gives up a server that is gone: an update of a server takes 4 to 10 s."""


def refuse(request):
    raise httpx2.ConnectError("refused")


def respond_as_proxy(request):
    return httpx2.Response(502, text="<html>")


@pytest.fixture
def slept(monkeypatch):
    """The pauses of both clients, which don't wait."""
    found = []

    async def sleep(seconds):
        found.append(seconds)

    monkeypatch.setattr(client_module.time, "sleep", found.append)
    monkeypatch.setattr(client_module.asyncio, "sleep", sleep)
    return found


def call(kind, transport, name, path=JOB, **options):
    """Calls a method of a job, or of its client, and returns the outcome."""

    async def act():
        client = kind("http://server/", transport=httpx2.MockTransport(transport), **options)
        job = (client_module.Job if kind is Client else client_module.AsyncJob)(client, path)
        if name == "events":
            return [event async for event in job.events()] if kind is AsyncClient else list(job.events())
        found = getattr(job, name)() if hasattr(job, name) else getattr(client, name)("scene:vase")
        return await found if kind is AsyncClient else found

    return asyncio.run(act())


@pytest.mark.parametrize("kind", [Client, AsyncClient])
@pytest.mark.parametrize("name", ["events", "status", "result"])
@pytest.mark.parametrize(("transport", "why"), [(refuse, "refused"), (respond_as_proxy, "502 Bad Gateway")])
def test_a_job_waits_for_its_server_for_a_minute(slept, kind, name, transport, why):
    path = f"/v1/upscales/{'0' * 32}"
    remedy = f"go on with client.job('{'0' * 32}', 'upscale') once the server is running"
    with pytest.raises(ConnectionFailed) as caught:
        call(kind, transport, name, path)
    assert str(caught.value) == f"http://server{path}: {why}; {remedy}"
    assert (slept, sum(slept)) == (PAUSES, 60)
    slept.clear()
    with pytest.raises(ConnectionFailed, match=re.escape(remedy)):
        call(kind, transport, name, path, retries=0)
    assert slept == []


@pytest.mark.parametrize("kind", [Client, AsyncClient])
def test_a_submission_to_no_server_fails_at_once(slept, kind):
    for name in ("submit", "reconstruct", "cancel"):
        with pytest.raises(ConnectionFailed, match=r"^http://server/?: refused; check the URL"):
            call(kind, refuse, name)
    assert slept == []


@pytest.mark.parametrize("kind", [Client, AsyncClient])
def test_a_reconstruction_goes_on_after_an_update_of_the_server(slept, kind):
    head = {"content-type": "text/event-stream"}
    answers = [
        httpx2.Response(202, json={"events": f"{JOB}/events"}),
        *[None] * 3,
        respond_as_proxy(None),
        make_problem(503, {"retry-after": "3"}),
        httpx2.Response(200, headers=head, content=b"event: done\ndata: {}\nid: 0\n\n"),
        *[None] * 2,
        httpx2.Response(200, headers=HEADERS, content=b"data"),
    ]

    def respond(request):
        return answers.pop(0) or refuse(request)

    assert call(kind, respond, "reconstruct", retries=1).content == b"data"
    assert slept == [1, 2, 4, 8, 3, 1, 2]
    assert answers == []


def test_a_server_that_cannot_be_reached(monkeypatch, eia_file):
    monkeypatch.setattr(client_messages, "PAUSE_SECONDS", 0)
    client = Client("http://127.0.0.1:9")
    with pytest.raises(ConnectionFailed, match=r"^http://127\.0\.0\.1:9.*check the URL"):
        client.submit(eia_file)

    async def ask():
        async with AsyncClient("http://127.0.0.1:9") as client:
            await client.models()

    with pytest.raises(ConnectionFailed):
        asyncio.run(ask())


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


@pytest.mark.parametrize(
    ("format_", "name", "remedy"),
    [
        ("png", "x.jpg", "the result is png; name it .png, or ask for format='jpeg'"),
        ("jpeg", "x.PNG", "the result is jpeg; name it .jpg, or ask for format='png'"),
        ("png", "x.zip", "the result is png; name it .png, or ask for format='zip'"),
        ("pfm", "x.npy", "the result is pfm; name it .pfm, or ask for format='npy'"),
        ("zip", "x.glb", "the result is zip; name it .zip, or ask for format='glb'"),
    ],
)
def test_a_name_of_another_format_is_refused(tmp_path, format_, name, remedy):
    with pytest.raises(errors.InvalidOption, match=f"{re.escape(remedy)}$"):
        Result("1", b"data", format_, {}, "1.png").save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("format_", "name"), [("jpeg", "x.jpeg"), ("jpeg", "x.JPG"), ("tiff", "x.tif"), ("png", "x"), ("png", "x.part")]
)
def test_other_names_are_as_they_are_given(tmp_path, format_, name):
    Result("1", b"data", format_, {}, "1.png").save(tmp_path / name)
    assert (tmp_path / name).read_bytes() == b"data"


def test_a_folder_is_made_for_a_result(tmp_path):
    Result("1", b"data", "png", {}, "1_qs5x9a1.png").save(f"{tmp_path}/new/folder/")
    assert (tmp_path / "new/folder/1_qs5x9a1.png").read_bytes() == b"data"


def test_a_result_is_saved_where_something_can_be_written(tmp_path):
    result = Result("1", b"data", "png", {}, "1.png")
    result.save(tmp_path / "new/folder/x.png")
    assert (tmp_path / "new/folder/x.png").read_bytes() == b"data"
    for place in (tmp_path / "new/folder/x.png/x.png", f"{tmp_path}/new/folder/x.png/"):
        with pytest.raises(InvalidOption, match=r"x.png: not a folder; name another place"):
            result.save(place)


def test_the_id_of_a_result_that_a_worker_of_another_version_made():
    client, _ = make_client(httpx2.Response(200, headers=HEADERS | {"etag": 'W/"1-abc"'}, content=b"data"))
    assert client.reconstruct("scene:vase", lenses=(5, 5), pixels=(5, 5)).id == "1"
