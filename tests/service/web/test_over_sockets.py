"""A real server: parallel requests, body limits, slow clients, start-up errors."""

import io
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import httpx2
import numpy as np
import pytest

from ciir.service.web.middleware.body_limit import OTHER_BYTES
from tests.support.backends import BACKENDS, require_backend
from tests.support.inputs import CUBE, EIA_PNG
from tests.support.servers import run_python, run_server

POST = "/v1/reconstructions"


def send(url, name, data, **fields):
    return httpx2.post(url + POST, files={"file": (name, data)}, data=fields, timeout=120)


def connect(url):
    host, port = url.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), timeout=30)


@pytest.mark.parametrize("backend", BACKENDS)
def test_parallel_requests(server, backend):
    require_backend(backend)

    def post(index):
        fields = {"lenses": f"{20 + index % 2}x20", "backend": backend, "model": "none", "views": "all"}
        return send(server, "cube.off", CUBE, format="npz", **fields)

    with ThreadPoolExecutor(8) as pool:
        responses = list(pool.map(post, range(8)))
    assert [response.status_code for response in responses] == [200] * 8
    views = [np.load(io.BytesIO(response.content))["views"] for response in responses]
    for index, other in enumerate(views):
        assert other.shape == (225, 20 + index % 2, 20, 3)
        assert np.array_equal(other, views[index % 2])


def test_healthz_responds_while_workers_are_busy(server):
    busy = threading.Event()
    seen = []

    def watch():
        with httpx2.Client() as client:
            while not busy.is_set():
                seen.append(client.get(server + "/healthz").status_code)

    watcher = threading.Thread(target=watch)
    watcher.start()
    start = len(seen)
    with ThreadPoolExecutor(3) as pool:
        requests = [
            pool.submit(send, server, "cube.off", CUBE, lenses="200x200", backend="raytrace", model="paper")
            for _ in range(3)  # the slowest network: more than half a second each
        ]
        responses = [future.result() for future in requests]
    answered = len(seen) - start
    busy.set()
    watcher.join()
    assert [response.status_code for response in responses] == [200] * 3
    assert set(seen) == {200}
    assert answered > 3  # it did not wait for the reconstructions


@pytest.fixture(scope="module")
def small_server(tmp_path_factory):
    with run_server(tmp_path_factory.mktemp("small") / "log", CIIR_WORKERS="1", CIIR_MAX_BODY_BYTES="100000") as server:
        yield server.url


def check_too_large(response):
    assert response.status_code == 413
    assert response.headers["content-type"] == "application/problem+json"
    assert response.json() == {
        "type": "urn:ciir:over-a-limit",
        "title": "Over a limit",
        "status": 413,
        "detail": "the request's body is over the limit of 100,000 bytes; send a smaller file",
        "instance": POST,
    }


@pytest.mark.parametrize("size", [100_001, 5_000_000])
def test_a_declared_body_over_the_limit(small_server, size):
    check_too_large(send(small_server, "a.png", bytes(size)))


@pytest.mark.parametrize("size", [100_001, 5_000_000])
def test_a_chunked_body_over_the_limit(small_server, size):
    def chunks():
        yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.png"\r\n\r\n'
        for _ in range(0, size, 50_000):
            yield bytes(50_000)
        yield b"\r\n--b--\r\n"

    headers = {"content-type": "multipart/form-data; boundary=b"}
    check_too_large(httpx2.post(small_server + POST, content=chunks(), headers=headers, timeout=60))


FORM = "Content-Type: multipart/form-data; boundary=b"


@pytest.mark.parametrize(
    "start", [b'--b\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n', b"broken"]
)
def test_an_endless_body_is_cut_off(small_server, start):
    def send_endlessly(connection):
        connection.sendall(
            f"POST {POST} HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n{FORM}\r\n\r\n".encode()
        )
        connection.sendall(b"%x\r\n%b\r\n" % (len(start), start))
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline:
            connection.sendall(b"10000\r\n" + bytes(0x10000) + b"\r\n")

    with connect(small_server) as connection, pytest.raises(ConnectionError):
        send_endlessly(connection)


@pytest.mark.parametrize("framing", ["Content-Length: 100001", "Transfer-Encoding: chunked"])
def test_the_connection_of_a_refused_body_is_closed(small_server, framing):
    headers = f"{framing}\r\n{FORM}"
    body = bytes(100_001)
    if "chunked" in framing:
        part = b"--b\r\nContent-Disposition: form-data; name=file; filename=a\r\n\r\n" + body
        body = b"%x\r\n%b\r\n" % (len(part), part)  # without an end
    with connect(small_server) as connection:
        connection.sendall(f"POST {POST} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n\r\n".encode() + body)
        response = b"".join(iter(lambda: connection.recv(65536), b""))  # to the end of the connection
    head = response.partition(b"\r\n\r\n")[0].lower()
    assert head.startswith(b"http/1.1 413")
    assert b"\r\nconnection: close" in head


def test_other_paths_have_a_small_limit_and_an_unread_body_closes_the_connection(small_server):
    for size, status in ((OTHER_BYTES, 200), (OTHER_BYTES + 1, 413)):
        response = httpx2.request("GET", small_server + "/healthz", content=bytes(size))
        assert (response.status_code, response.headers["connection"]) == (status, "close")


def test_a_mistyped_path_with_a_large_file_is_not_found(small_server):
    for path, status in (("/v1/reconstruction", 404), ("/v1/v1/upscales", 404), ("/v1/models", 405)):
        response = httpx2.post(small_server + path, files={"file": ("a.glb", bytes(200_000))})
        assert (response.status_code, response.headers["connection"]) == (status, "close")


def test_declared_and_chunked_bodies_below_the_limit(small_server):
    data = EIA_PNG
    declared = send(small_server, "a.png", data, lenses="6x9", model="none")
    head = b'--b\r\nContent-Disposition: form-data; name="%s"%s\r\n\r\n%s\r\n'
    body = head % (b"lenses", b"", b"6x9") + head % (b"model", b"", b"none")
    body += head % (b"file", b'; filename="a.png"', data) + b"--b--\r\n"
    headers = {"content-type": "multipart/form-data; boundary=b"}
    chunked = httpx2.post(small_server + POST, content=iter([body[:100], body[100:]]), headers=headers, timeout=60)
    assert (declared.status_code, chunked.status_code) == (200, 200)
    assert declared.content == chunked.content


def test_expect_100_continue_is_refused_at_once(small_server):
    with connect(small_server) as connection:
        connection.sendall(
            f"POST {POST} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999999\r\nExpect: 100-continue\r\n"
            "Content-Type: multipart/form-data; boundary=b\r\n\r\n".encode()
        )
        assert connection.recv(100).startswith(b"HTTP/1.1 413")


def test_a_refused_body_that_stalls(small_server):
    with connect(small_server) as connection:
        connection.sendall(f"POST {POST} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999999\r\n\r\nxyz".encode())
        assert connection.recv(100).startswith(b"HTTP/1.1 413")


@pytest.fixture(scope="module")
def short_server(tmp_path_factory):
    """One worker and short timeouts for clients."""
    log = tmp_path_factory.mktemp("short") / "log"
    with run_server(log, CIIR_WORKERS="1", CIIR_BODY_SECONDS="3", CIIR_CLIENT_SECONDS="1") as server:
        yield server.url


def test_a_slow_body_is_cut_off_and_holds_no_worker(short_server):
    with connect(short_server) as connection:
        connection.sendall(
            f"POST {POST} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n{FORM}\r\n\r\n".encode()
        )
        part = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
        for byte in part[:8]:
            connection.sendall(bytes([byte]))
        fields = {"lenses": "6x9", "model": "none"}
        assert send(short_server, "a.png", EIA_PNG, **fields).status_code == 200
        connection.settimeout(0.1)
        response = b""
        for byte in part[8:]:  # takes longer than the timeout
            connection.sendall(bytes([byte]))
            try:
                response = connection.recv(65536)
            except TimeoutError:
                continue
            break
        connection.settimeout(30)
        with suppress(ConnectionResetError):  # by a byte that was on its way when the server closed the connection
            while more := connection.recv(65536):
                response += more
    assert response.startswith(b"HTTP/1.1 408")
    assert b"application/problem+json" in response
    assert b"not complete after 3 s" in response


def test_a_port_that_is_taken(server):
    done = run_python("-m", "ciir", "serve", "--port", server.rpartition(":")[2])
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "already in use" in done.stderr
