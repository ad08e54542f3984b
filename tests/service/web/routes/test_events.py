"""Event streams: limits, and what many of them cost."""

import json
import socket
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx2
import pytest
from starlette.exceptions import HTTPException

from ciir.service.web.routes.events import OpenStreams
from tests.support.inputs import EIA_PNG
from tests.support.servers import run_server
from tests.support.waiting import wait_until

POST = "/v1/reconstructions"
KEYS = ({"X-API-Key": "one"}, {"Authorization": "Bearer two"})


def test_streams_are_counted_by_client_and_in_all():
    streams = OpenStreams(3, 2)
    with streams.count("a"):
        with streams.count("a"), streams.count("b"):
            with pytest.raises(HTTPException, match="of this client") as caught, streams.count("a"):
                pass
            assert (caught.value.status_code, caught.value.headers) == (429, {"Retry-After": "5"})
            with pytest.raises(HTTPException, match="this server allows"), streams.count("c"):
                pass
        with streams.count("a"):
            pass
    assert not streams._open


@pytest.fixture(scope="module")
def waiting_server(tmp_path_factory):
    """A server without workers, with two keys: (address, path of a waiting job, process id)."""
    log = tmp_path_factory.mktemp("streams") / "log"
    limits = {"CIIR_MAX_STREAMS": "405", "CIIR_MAX_CLIENT_STREAMS": "401"}
    with run_server(log, CIIR_WORKERS="0", CIIR_API_KEYS="one,two", **limits) as server:
        headers = KEYS[0] | {"Prefer": "respond-async"}
        response = httpx2.post(server.url + POST, files={"file": ("a.png", EIA_PNG)}, headers=headers)
        yield server, response.headers["location"]


@contextmanager
def open_stream(server, path, headers):
    """The status of a request for events, whose connection stays open."""
    lines = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(
            f"GET {path}/events HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{lines}\r\n".encode()
        )
        file = connection.makefile("rb")
        yield int(file.readline().split()[1]), file


def read_cpu_seconds(pid):
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / 100


def test_many_streams_of_a_waiting_job_are_limited_and_cost_nothing(waiting_server):
    server, path = waiting_server
    with ExitStack() as stack:
        found = [stack.enter_context(open_stream(server, path, KEYS[0]))[0] for _ in range(401)]
        assert set(found) == {200}
        with open_stream(server, path, KEYS[0]) as (status, file):
            assert status == 429
            head, _, body = file.read().partition(b"\r\n\r\n")
        assert b"retry-after: 5" in head
        assert "as many as it may have; close one" in json.loads(body)["detail"]
        found = [stack.enter_context(open_stream(server, path, KEYS[1]))[0] for _ in range(5)]
        assert found == [200] * 4 + [429]  # of another client, until there are 405 in all
        before = read_cpu_seconds(server.pid)
        time.sleep(2)
        assert read_cpu_seconds(server.pid) - before < 0.25  # of two seconds; it was 0.7 when each stream polled

    def open_another():
        with open_stream(server, path, KEYS[0]) as (status, _):
            return status == 200

    wait_until(open_another)  # the places are free again
