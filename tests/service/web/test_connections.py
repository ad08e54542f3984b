"""Connections and the limit on open files."""

import asyncio
import errno
import re
import resource
import socket
import time
from contextlib import ExitStack
from pathlib import Path

import httpx2
import pytest

from ciir.service.settings import Settings
from ciir.service.web import connections as module
from tests.support.inputs import EIA_PNG
from tests.support.servers import run_server

pytestmark = pytest.mark.slow


def test_more_connections_than_open_files_leave_a_server_at_work(tmp_path):
    log = tmp_path / "log"
    with ExitStack() as stack, run_server(log, setup="ulimit -n 256", CIIR_WORKERS="1") as server:
        for _ in range(400):  # neither of them says anything
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=10))
        headers = {"Prefer": "respond-async"}
        with httpx2.Client(base_url=server.url, timeout=10) as client:
            for number in range(10):
                assert client.get("/healthz").status_code == 200
                files = {"file": ("a.png", EIA_PNG + bytes([number]))}
                assert client.post("/v1/reconstructions", files=files, headers=headers).status_code == 202
        assert len(list(Path(f"/proc/{server.pid}/fd").iterdir())) < 200
        text = log.read_text()
    assert "256 open files, which allows 62 connections of CIIR_MAX_CONNECTIONS=2000" in text
    assert len(text) < 20_000
    assert "Traceback" not in text


def test_the_soft_limit_is_raised_to_the_hard_one(tmp_path):
    with run_server(tmp_path / "log", setup="ulimit -n 1000; ulimit -S -n 200", CIIR_WORKERS="0") as server:
        limits = Path(f"/proc/{server.pid}/limits").read_text()
    assert re.search(r"Max open files +1000 +1000 ", limits)


@pytest.mark.parametrize(("files", "most"), [(-1, 2000), (20_000, 2000), (1000, 432), (100, 1)])
def test_connections_by_open_files(monkeypatch, files, most):
    monkeypatch.setattr(resource, "getrlimit", lambda which: (files, files))
    assert module.find_most(Settings(workers=2)) == most


def test_errors_of_accepting_are_logged_once_a_second(monkeypatch, caplog):
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    handle, loop = module.AcceptErrors(), asyncio.new_event_loop()
    message = "socket.accept() out of system resource"
    for seconds in (0.0, 0.5, 0.9, 1.0, 1.5):
        clock[0] = seconds
        for _ in range(100):
            handle(loop, {"message": message, "exception": OSError(errno.EMFILE, "Too many open files")})
    lines = [record.getMessage() for record in caplog.records]
    assert lines == ["no connection can be accepted (Too many open files); lower CIIR_MAX_CONNECTIONS"] * 2
    handle(loop, {"message": "Task exception was never retrieved", "exception": OSError(errno.EMFILE, "x")})
    assert caplog.records[-1].name == "asyncio"
    loop.close()
