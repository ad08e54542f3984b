"""Runs `ciir` as a separate process: a command that ends, a server, a worker."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ciir.service.jobs.workers.worker import MODULE
from tests.load.server import descendants

if TYPE_CHECKING:
    from collections.abc import Iterator

START_SECONDS = STOP_SECONDS = 120


class Server(NamedTuple):
    """A running server."""

    url: str
    pid: int

    @property
    def port(self) -> int:
        """The port on 127.0.0.1."""
        return int(self.url.rpartition(":")[2])


def run_python(*argv: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Runs a new Python process until it ends. Its output is text."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.run([sys.executable, *map(str, argv)], check=False, text=True, **options)  # noqa: S603 - our own


@contextmanager
def run_ciir(log: Path, *arguments: str, setup: str = "", **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    """Runs `ciir` in the background, with its output in `log` and its jobs in the same folder unless `CIIR_FOLDER` is
    given.

    `setup`: a shell command that is run first, such as `ulimit -n 256`. SIGTERM ends the process, and its exit status
    must be 0.
    """
    environment = {"CIIR_FOLDER": str(log.with_name("service"))} | environment
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 - our own
            ["/bin/sh", "-ec", f'{setup}\nexec "$@"', "sh", sys.executable, "-m", "ciir", *arguments],
            stdout=output,
            stderr=output,
            env=os.environ | environment,
        )
    try:
        yield process
    finally:
        process.terminate()
        try:
            status = process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        assert status == 0, log.read_text()[-5000:]


@contextmanager
def run_server(log: Path, setup: str = "", **environment: str) -> Iterator[Server]:
    """Runs `ciir serve` on a free port with `run_ciir`, and yields it once it is ready."""
    with run_ciir(log, "serve", "--port", "0", setup=setup, **environment) as process:
        deadline = time.monotonic() + START_SECONDS
        while (found := re.search(r"http://127\.0\.0\.1:\d+", log.read_text())) is None or not _is_ready(found[0]):
            assert process.poll() is None, log.read_text()[-5000:]
            assert time.monotonic() < deadline, log.read_text()[-5000:]
            time.sleep(0.05)
        yield Server(found[0], process.pid)
    assert "Application shutdown complete" in log.read_text()


def _is_ready(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=10) as answer:  # noqa: S310 - our own
            return bool(answer.status == 200)
    except urllib.error.HTTPError:
        return False


def find_workers(pid: int, module: str = MODULE) -> list[int]:
    """Finds the ids of a server's worker processes, or of those that run another `module`."""
    return [each for each in descendants(pid) if module.encode() in Path(f"/proc/{each}/cmdline").read_bytes()]


class Line:
    """A port of this machine that forwards connections to a server, until `cut` ends them as a stopped server would."""

    def __init__(self, target: int) -> None:
        self.target = target
        self.port = 0
        self.sockets: list[socket.socket] = []
        self.mend()

    def mend(self) -> None:
        """Listens on the same port as before."""
        listener = socket.create_server(("127.0.0.1", self.port))
        self.port = listener.getsockname()[1]
        self.sockets = [listener]
        threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def cut(self) -> None:
        """Closes all connections. New ones are refused."""
        for each in self.sockets:
            with suppress(OSError):  # the other end may be closed already
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self, listener: socket.socket) -> None:
        with suppress(OSError):  # closed
            while True:
                ends = listener.accept()[0], socket.create_connection(("127.0.0.1", self.target))
                self.sockets += ends
                for source, sink in (ends, ends[::-1]):
                    threading.Thread(target=_copy, args=(source, sink), daemon=True).start()


def _copy(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            sink.sendall(data)
        sink.shutdown(socket.SHUT_WR)
