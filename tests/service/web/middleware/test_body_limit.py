"""Body limits in this process; tests/service/web/test_over_sockets.py has those over sockets."""

import anyio
import pytest
from starlette.exceptions import HTTPException
from starlette.requests import Request

from ciir.errors import TooLarge
from ciir.service.web.middleware.body_limit import OTHER_BYTES, BodyLimit


def request(chunks, headers=(), *, path="/upload", seconds=60.0, read=True):
    """Status and `Connection` of the response. A chunk `...`: nothing more arrives. `read`: the app reads the body."""
    sent = []

    async def receive():
        if chunks and chunks[0] is ...:
            await anyio.sleep_forever()
        body = chunks.pop(0) if chunks else b""
        return {"type": "http.request", "body": body, "more_body": bool(chunks)}

    async def send(message):
        sent.append(message)

    async def app(scope, receive, send):
        if read:
            await Request(scope, receive).body()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def run():
        scope = {"type": "http", "method": "POST", "path": path, "headers": list(headers)}
        await BodyLimit(app, {"/upload": 10_000}, seconds)(scope, receive, send)

    anyio.run(run)
    return sent[0]["status"], dict(sent[0]["headers"]).get(b"connection")


CHUNKED = [(b"transfer-encoding", b"chunked")]


def declared(size):
    return [(b"content-length", str(size).encode())]


def test_within_the_limit():
    assert request([bytes(10_000)], declared(10_000)) == (200, None)
    assert request([bytes(5_000), bytes(5_000)], CHUNKED) == (200, None)
    assert request([]) == (200, None)


def test_over_the_limit():
    assert request([bytes(10_001)], declared(10_001)) == (413, b"close")
    with pytest.raises(TooLarge, match="10,000"):
        request([bytes(5_000), bytes(5_001)], CHUNKED)


def test_other_paths_have_a_small_limit():
    assert request([bytes(OTHER_BYTES)], declared(OTHER_BYTES), path="/other") == (200, None)
    assert request([bytes(OTHER_BYTES + 1)], declared(OTHER_BYTES + 1), path="/other") == (413, b"close")


@pytest.mark.parametrize("headers", [declared(100), CHUNKED])
def test_an_unread_body_closes_the_connection(headers):
    assert request([bytes(50), bytes(50)], headers, read=False) == (200, b"close")


@pytest.mark.parametrize("headers", [declared(100), CHUNKED])
def test_a_body_that_does_not_arrive(headers):
    with pytest.raises(HTTPException, match=r"not complete after 0\.05 s") as caught:
        request([bytes(50), ...], headers, seconds=0.05)
    assert caught.value.status_code == 408
