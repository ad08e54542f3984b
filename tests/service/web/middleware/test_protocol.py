"""Slow, broken and too many clients over real sockets, with short timeouts."""

import json
import re
import socket
import struct
import threading
import time
from contextlib import ExitStack, contextmanager

import pytest
import uvicorn

from ciir.service.metrics import Metrics
from ciir.service.web.middleware import protocol
from ciir.service.web.middleware.protocol import SPARE, make_protocol
from ciir.service.web.middleware.tracking import SECURITY_HEADERS, RequestTracking
from tests.support.waiting import wait_until

SECONDS = 0.3
MOST = 8
"""Connections."""
METRICS = Metrics()
LARGE = 64 * 2**20
"""More than the kernel's socket buffers hold."""


async def app(scope, receive, send):
    """Reads the body and responds with as many bytes as the path says, with a query in one piece."""
    while (await receive()).get("more_body", False):
        pass
    size = 3 if scope["path"] == "/healthz" else int(scope["path"].removeprefix("/"))
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", str(size).encode())]})
    if scope["query_string"]:
        await send({"type": "http.response.body", "body": bytes(size)})
        return
    for _ in range(0, size, 2**18):
        await send({"type": "http.response.body", "body": bytes(min(size, 2**18)), "more_body": True})
    await send({"type": "http.response.body", "body": b""})


@pytest.fixture(scope="module")
def port():
    with run_protocol(SECONDS) as port:
        yield port


@pytest.fixture
def patient_port():
    """Of a server that waits long for slow clients."""
    with run_protocol(30) as port:
        yield port


@contextmanager
def run_protocol(seconds):
    config = uvicorn.Config(
        RequestTracking(app, Metrics()),
        http=make_protocol(seconds, MOST, METRICS),
        ws="none",
        lifespan="off",
        log_config=None,
        timeout_keep_alive=max(1, seconds),
        access_log=False,
    )
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        yield listener.getsockname()[1]
        server.should_exit = True
        thread.join(30)
        assert not thread.is_alive()


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


@pytest.fixture
def lines(caplog):
    """Lists the lines of the access log."""
    caplog.set_level("INFO", "ciir.access")
    return lambda: [record.message for record in caplog.records if record.name == "ciir.access"]


GET_LARGE = b"GET /%d HTTP/1.1\r\nHost: x\r\n\r\n" % LARGE
NOTHING_READ = f"the client read nothing for {SECONDS} s"


def find_milliseconds(line):
    return float(re.search(r" 200 ([\d.]+) ms", line)[1])


def test_a_client_that_reads_nothing_is_cut_off_in_time(port, lines):
    with connected(port) as connection:
        start = time.monotonic()
        connection.sendall(GET_LARGE)
        wait_until(lines)
    assert time.monotonic() - start > SECONDS
    (line,) = lines()
    assert find_milliseconds(line) < 3000 * SECONDS
    assert line.endswith(f" out, cut: {NOTHING_READ}")


def test_a_client_that_reads_nothing_of_a_complete_response_has_a_line_of_its_own(port, lines):
    with connected(port) as connection:
        client = "{}:{}".format(*connection.getsockname())
        connection.sendall(GET_LARGE.replace(b" HTTP", b"?at-once HTTP"))
        wait_until(lambda: len(lines()) == 2)
    assert lines()[0].endswith(f"{LARGE} out")
    assert lines()[1] == f"cut the connection to {client}: {NOTHING_READ}"


def test_a_connection_that_was_reset_is_left_alone(port, lines, caplog):
    with connected(port) as connection:
        connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        wait_until(lines)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    time.sleep(1 + 2 * SECONDS)  # after the time for another request, and the time to read
    assert len(lines()) == 1
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []


def read_slowly(port, seconds):
    """Reads about 1 MB/s, a small part of what the kernel buffers, for that long. Returns the number of bytes."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**17)
        connection.connect(("127.0.0.1", port))
        connection.sendall(GET_LARGE)
        end, read = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            time.sleep(SECONDS / 10)
            read += len(connection.recv(2**15))
    return read


def test_a_client_that_reads_slowly_is_not_cut_off(port, lines):
    assert read_slowly(port, 6 * SECONDS) < 2 * 2**20
    wait_until(lines)
    assert find_milliseconds(lines()[0]) > 5900 * SECONDS
    assert "cut" not in lines()[0]


def test_without_the_kernels_count_such_a_client_is_cut_off(port, lines, monkeypatch):
    def refuse(*given):
        raise OSError

    monkeypatch.setattr(protocol.fcntl, "ioctl", refuse)
    read_slowly(port, 6 * SECONDS)
    assert lines()[0].endswith(NOTHING_READ)


def test_when_the_server_stops_a_response_is_cut_without_an_error(caplog, lines, monkeypatch):
    monkeypatch.setattr(protocol, "RESPONSE_SECONDS", 0.2)
    with ExitStack() as stack:
        with run_protocol(30) as port:
            connection = stack.enter_context(connected(port))
            connection.sendall(GET_LARGE)
            connection.recv(1)
        assert lines()[0].endswith("cut: the server stopped")
    assert [record for record in caplog.records if record.levelname == "ERROR"] == []


def test_an_idle_client(port):
    with connected(port) as connection:
        connection.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        wait_for_end(connection)


def test_bytes_that_are_not_http(port):
    with connected(port) as connection:
        connection.sendall(b"\x16\x03\x01 nonsense\r\n\r\n")
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))
    head, _, body = answer.lower().partition(b"\r\n\r\n")
    assert head.startswith(b"http/1.1 400")
    assert b"content-type: application/problem+json" in head
    assert b"x-request-id: " in head
    assert set(json.loads(body)) == {"type", "title", "status", "detail", "instance"}


def test_a_malformed_chunk(port):
    with connected(port) as connection:
        connection.sendall(b"POST /3 HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\nzz\r\n")
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))
    assert json.loads(answer.partition(b"\r\n\r\n")[2])["detail"].startswith("illegal chunk header: 'zz'; send")


LENGTH = b"POST /3 HTTP/1.1\r\nHost: x\r\n%s\r\n\r\n5\r\nhello\r\n0\r\n\r\nGET /3 HTTP/1.1\r\nHost: x\r\n\r\n"


@pytest.mark.parametrize(
    ("headers", "cause"),
    [
        (b"Content-Length: 5\r\nTransfer-Encoding: chunked", "Content-Length and Transfer-Encoding are both given"),
        (b"transfer-encoding:chunked\r\ncontent-length:5", "Content-Length and Transfer-Encoding are both given"),
        (b"Content-Length: 5, 5", "Content-Length is not a single number"),
        (b"Content-Length: 5\r\nContent-Length: 5", "Content-Length is not a single number"),
        (b"X: y\nContent-Length: 5,5", "Content-Length is not a single number"),
        (b"Content-Length: 5\r\n ,5", "a header continues on a second line"),
        (b"Content-Length: +5", "bad Content-Length"),
    ],
)
def test_framing_that_a_proxy_may_read_otherwise_is_refused(port, headers, cause):
    with connected(port) as connection:
        connection.sendall(LENGTH % headers)
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))  # to the end of the connection
    assert answer.startswith(b"HTTP/1.1 400")
    assert answer.lower().count(b"content-type: ") == 1
    assert json.loads(answer.partition(b"\r\n\r\n")[2])["detail"].startswith(f"{cause}; send ")


def count(method, status):
    sample = {"method": method, "route": "other", "status": status}
    return METRICS.registry.get_sample_value("ciir_http_requests_total", sample) or 0


def test_a_refused_request_has_all_headers_and_is_logged_and_counted(port, caplog):
    caplog.set_level("INFO")
    before = count("POST", "400")
    with connected(port) as connection:
        client = "{}:{}".format(*connection.getsockname())
        request = b"POST /v1/upscales?a HTTP/1.1\r\nHost: x\r\nX-Request-Id: mine\r\nContent-Length: 5, 5\r\n\r\nabcde"
        connection.sendall(request)
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))
    head, _, body = answer.decode().partition("\r\n\r\n")
    for name, value in (SECURITY_HEADERS | {"X-Request-Id": "mine"}).items():
        assert f"\r\n{name}: {value}".lower() in head.lower()
    assert json.loads(body)["instance"] == "/v1/upscales"
    (line,) = [record.message for record in caplog.records if record.name == "ciir.access"]
    assert line.startswith(f"refused POST /v1/upscales from {client}: 400, Content-Length is not a single number; send")
    assert count("POST", "400") == before + 1


def test_the_second_of_two_requests_is_checked_too(port):
    with connected(port) as connection:
        connection.sendall(b"GET /0 HTTP/1.1\r\nHost: x\r\n\r\n" + LENGTH % b"Content-Length: 5, 5")
        answer = b"".join(iter(lambda: connection.recv(2**16), b""))
    assert re.findall(rb"^HTTP/1.1 (\d+)", answer, re.MULTILINE) == [b"200", b"400"]


def ask(connection):
    connection.sendall(b"GET /0 HTTP/1.1\r\nHost: x\r\n\r\n")
    return connection.recv(2**16)[:12]


def test_the_connection_that_is_idle_for_longest_ends_for_a_new_one(patient_port):
    with ExitStack() as stack:
        connections = [stack.enter_context(connected(patient_port)) for _ in range(MOST)]
        connections[1].sendall(b"GET /3 HT")  # the head of a slow client is not complete
        for connection in connections[2:]:
            assert ask(connection) == b"HTTP/1.1 200"
        assert ask(connections[0]) == b"HTTP/1.1 200"
        for oldest in (1, 2, 3):
            assert ask(stack.enter_context(connected(patient_port))) == b"HTTP/1.1 200"
            wait_for_end(connections[oldest])
        for connection in (connections[0], *connections[4:]):
            assert ask(connection) == b"HTTP/1.1 200"


def test_while_none_is_idle_a_new_connection_is_refused(patient_port):
    with ExitStack() as stack:
        connections = [stack.enter_context(connected(patient_port)) for _ in range(MOST)]
        for connection in connections:
            connection.sendall(b"POST /3 HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\n\r\n")
        time.sleep(0.2)
        with connected(patient_port) as connection:
            answer = b"".join(iter(lambda: connection.recv(2**16), b""))
        assert answer.startswith(b"HTTP/1.1 503")
        assert b"retry-after: 1" in answer.lower()
        assert count("other", "503") == 1
        assert b"the server has 8 connections open; try again" in answer
        for connection in connections:
            connection.sendall(b"x")
            assert connection.recv(2**16).startswith(b"HTTP/1.1 200")


def test_while_none_is_idle_only_health_is_answered(patient_port):
    with ExitStack() as stack:
        busy = [stack.enter_context(connected(patient_port)) for _ in range(MOST)]
        for connection in busy:
            connection.sendall(b"POST /3 HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\n\r\n")
        time.sleep(0.2)
        health, half, other, silent = [stack.enter_context(connected(patient_port)) for _ in range(SPARE)]
        with connected(patient_port) as more:  # refused at once
            assert more.recv(2**16).startswith(b"HTTP/1.1 503")
        for connection, part in ((half, b"GET /healthz HTTP/1.1\r\nHost:"), (health, b"GET /heal")):
            connection.sendall(part)
        time.sleep(0.1)
        health.sendall(b"thz HTTP/1.1\r\nHost: x\r\n\r\n")
        assert health.recv(2**16).startswith(b"HTTP/1.1 200")
        other.sendall(b"GET /3 HTTP/1.1\r\nHost: x\r\n\r\n")
        answer = b"".join(iter(lambda: other.recv(2**16), b""))
        assert answer.startswith(b"HTTP/1.1 503")
        assert b'"instance": "/3"' in answer
        for connection in (half, silent):  # after `SPARE_SECONDS`
            assert connection.recv(2**16).startswith(b"HTTP/1.1 503")
        busy[0].sendall(b"x")
        assert busy[0].recv(2**16).startswith(b"HTTP/1.1 200")
