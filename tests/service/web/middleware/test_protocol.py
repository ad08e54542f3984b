"""Slow and broken clients over real sockets, with short timeouts."""

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
"""More than the kernel's socket buffers hold."""


async def app(scope, receive, send):
    """Reads the body and responds with as many bytes as the path says."""
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


def wait_for_end(connection):
    """Waits for the end of the connection, orderly or not."""
    try:
        while connection.recv(2**16):
            pass
    except ConnectionError:
        pass


def drip(connection, text):
    """Sends `text` byte by byte, in many times the timeout."""
    for byte in text:
        connection.sendall(bytes([byte]))
        time.sleep(SECONDS / 8)


def test_a_good_client(port):
    with connected(port) as connection:
        for _ in range(2):
            connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
            answer = b""
            while not answer.endswith(b"\0\0\0"):
                answer += connection.recv(2**16)
            assert answer.startswith(b"HTTP/1.1 200")


def test_a_silent_client(port):
    with connected(port) as connection:
        wait_for_end(connection)


def test_a_slow_head(port):
    with connected(port) as connection, pytest.raises(ConnectionError):
        drip(connection, b"GET /3 HTTP/1.1\r\nHost: x\r\nX-Long: " + b"x" * 100)


def test_a_slow_head_of_a_second_request(port):
    with connected(port) as connection:
        connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        with pytest.raises(ConnectionError):
            drip(connection, b"GET /3 HTTP/1.1\r\nHost: x\r\nX-Long: " + b"x" * 100)


def test_a_client_that_stops_reading(port):
    with connected(port) as connection:
        connection.sendall(b"GET /%d HTTP/1.1\r\nHost: x\r\n\r\n" % LARGE)
        with pytest.raises(ConnectionError):  # a reset, as the rest cannot be sent
            drip(connection, b"\r\n" * 50)


def test_an_idle_client(port):
    with connected(port) as connection:
        connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        wait_for_end(connection)


def test_bytes_that_are_not_http(port):
    with connected(port) as connection:
        connection.sendall(b"\x16\x03\x01 nonsense\r\n\r\n")
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400")
    assert b"content-type: application/problem+json" in head
    assert b"x-request-id: " in head
    assert set(json.loads(body)) == {"type", "title", "status", "detail", "instance"}


def test_a_malformed_chunk(port):
    with connected(port) as connection:
        connection.sendall(b"POST /3 HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\nnonsense\r\n")
        assert b"application/problem+json" in b"".join(iter(lambda: connection.recv(2**16), b""))
