"""`ciir` as a process of its own: a command that ends, a server, a worker."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
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
    """Runs a new Python to its end; its output is text."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.run([sys.executable, *map(str, argv)], check=False, text=True, **options)  # noqa: S603 - our own


@contextmanager
def run_ciir(log: Path, *arguments: str, setup: str = "", **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    """Runs `ciir` in the background, its output in `log`, its jobs beside it unless `CIIR_FOLDER` is given.

    `setup`: what a shell runs first, such as `ulimit -n 256`. SIGTERM ends it, and its exit status must be 0.
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
    """Runs `ciir serve` on a free port, as `run_ciir` does, and yields it once it is ready."""
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
    """The process ids of the worker processes of a server, or of those that run another `module`."""
    return [each for each in descendants(pid) if module.encode() in Path(f"/proc/{each}/cmdline").read_bytes()]
