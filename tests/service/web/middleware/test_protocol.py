"""Clients that don't do their part, over real sockets; how long they have is made short."""

import json
import socket
import threading
import time
from contextlib import contextmanager

import pytest
import uvicorn

from ciir.service.web.middleware.protocol import make_protocol

SECONDS = 0.3
LARGE = 64 * 2**20
"""More than the kernel's buffers take."""


async def app(scope, receive, send):
    """Answers with as many bytes as the path says, once it has the body."""
    while (await receive()).get("more_body", False):
        pass
    size = int(scope["path"].removeprefix("/"))
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", str(size).encode())]})
    for _ in range(0, size, 2**18):
        await send({"type": "http.response.body", "body": bytes(min(size, 2**18)), "more_body": True})
    await send({"type": "http.response.body", "body": b""})


@pytest.fixture(scope="module")
def port():
    config = uvicorn.Config(
        app,
        http=make_protocol(SECONDS),
        ws="none",
        lifespan="off",
        log_config=None,
        timeout_keep_alive=1,
        access_log=False,
    )
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        yield listener.getsockname()[1]
        server.should_exit = True
        thread.join(30)


@contextmanager
def connected(port):
    with socket.create_connection(("127.0.0.1", port), timeout=30) as connection:
        yield connection


def is_cut_off(connection):
    """Waits for the end of the connection, whichever way it comes."""
    try:
        while connection.recv(2**16):
            pass
    except ConnectionError:
        pass
    return True


def drip(connection, text):
    """Sends `text` a byte at a time, so slowly that it takes many times as long as is waited for it."""
    for byte in text:
        connection.sendall(bytes([byte]))
        time.sleep(SECONDS / 8)


def test_one_that_does_its_part(port):
    with connected(port) as connection:
        for _ in range(2):
            connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
            answer = b""
            while not answer.endswith(b"\0\0\0"):
                answer += connection.recv(2**16)
            assert answer.startswith(b"HTTP/1.1 200")


def test_one_that_says_nothing(port):
    with connected(port) as connection:
        assert is_cut_off(connection)


def test_one_that_sends_its_head_a_byte_at_a_time(port):
    with connected(port) as connection, pytest.raises(ConnectionError):
        drip(connection, b"GET /3 HTTP/1.1\r\nHost: x\r\nX-Long: " + b"x" * 100)


def test_one_that_does_so_with_its_second_request(port):
    with connected(port) as connection:
        connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        with pytest.raises(ConnectionError):
            drip(connection, b"GET /3 HTTP/1.1\r\nHost: x\r\nX-Long: " + b"x" * 100)


def test_one_that_stops_reading(port):
    with connected(port) as connection:
        connection.sendall(b"GET /%d HTTP/1.1\r\nHost: x\r\n\r\n" % LARGE)
        with pytest.raises(ConnectionError):  # it is reset, as what it hasn't read can't be sent
            drip(connection, b"\r\n" * 50)


def test_one_that_asks_for_nothing_more(port):
    with connected(port) as connection:
        connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        assert is_cut_off(connection)


def test_one_that_speaks_something_else(port):
    with connected(port) as connection:
        connection.sendall(b"\x16\x03\x01 nonsense\r\n\r\n")
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400")
    assert b"content-type: application/problem+json" in head
    assert b"x-request-id: " in head
    assert set(json.loads(body)) == {"type", "title", "status", "detail", "instance"}


def test_one_whose_body_breaks_off_into_nonsense(port):
    with connected(port) as connection:
        connection.sendall(b"POST /3 HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\nnonsense\r\n")
        assert b"application/problem+json" in b"".join(iter(lambda: connection.recv(2**16), b""))
