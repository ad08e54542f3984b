"""A `ciir serve` of its own for `benchmarks.load`."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

START_SECONDS = STOP_SECONDS = 120


class Server(NamedTuple):
    """It runs."""

    port: int
    pid: int


@contextlib.contextmanager
def serving(folder: Path, log: Path) -> Iterator[Server]:
    """The server on a free port, ready; it is told to end, and must, within `STOP_SECONDS`."""
    command = [sys.executable, "-m", "service.cli", "serve", "--port", "0"]
    environment = os.environ | {"CIIR_FOLDER": str(folder / "jobs"), "CIIR_CACHE": str(folder / "cache")}
    with log.open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    try:
        end = time.monotonic() + START_SECONDS
        while (found := re.search(r"http://127\.0\.0\.1:(\d+)", log.read_text())) is None or not _is_ready(found[0]):
            if process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"the server doesn't start: {log.read_text()[-2000:]}")
            time.sleep(0.05)
        yield Server(int(found[1]), process.pid)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


def _is_ready(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=10) as answer:  # noqa: S310 - our own
            return bool(answer.status == 200)
    except urllib.error.HTTPError:
        return False
