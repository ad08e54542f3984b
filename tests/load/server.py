"""A `ciir serve` for tests under load, and samples of its memory and of /healthz while it works."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypedDict

if TYPE_CHECKING:
    from collections.abc import Iterator
    from multiprocessing.synchronize import Event

START_SECONDS = STOP_SECONDS = 120
EVERY_SECONDS = 0.1
PAGE = 4096
ANSWER_SECONDS = 10


class Server(NamedTuple):
    """It runs."""

    port: int
    pid: int


@contextlib.contextmanager
def serving(folder: Path, log: Path) -> Iterator[Server]:
    """The server on a free port, ready; at the end it must stop within `STOP_SECONDS`."""
    command = [sys.executable, "-m", "ciir", "serve", "--port", "0"]
    environment = os.environ | {"CIIR_FOLDER": str(folder / "jobs"), "CIIR_CACHE": str(folder / "cache")}
    with log.open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)  # noqa: S603 - our own
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


class Seen(TypedDict):
    """Samples."""

    health_ms: list[float]
    """Milliseconds from asking /healthz, on an open connection, to its last byte."""
    bytes: list[int]
    """Resident bytes of the server and all that it started, shared pages counted in each."""
    web_bytes: list[int]
    """Of them those of the server's own process."""
    processes: list[int]


def watch(port: int, pid: int, stop: Event, out: Path) -> None:
    """Samples until `stop` is set, then writes `Seen` as JSON to `out`. Run it in a separate process: in a busy client
    the server would seem slow.
    """
    seen: Seen = {"health_ms": [], "bytes": [], "web_bytes": [], "processes": []}
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_SECONDS)
    while not stop.wait(EVERY_SECONDS):
        asked = time.perf_counter()
        connection.request("GET", "/healthz")
        answer = connection.getresponse()
        answer.read()
        took = time.perf_counter() - asked
        if answer.status != 200:
            raise RuntimeError(f"/healthz answers {answer.status}")
        family = descendants(pid)
        seen["health_ms"].append(1000 * took)
        seen["bytes"].append(sum(resident(one) for one in family))
        seen["web_bytes"].append(resident(pid))
        seen["processes"].append(len(family))
    out.write_text(json.dumps(seen))


def descendants(pid: int) -> list[int]:
    """`pid` and every process that came of it and still runs."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").iterdir():
        if path.name.isdecimal() and (parent := _parent(path)) is not None:
            children.setdefault(parent, []).append(int(path.name))
    family, waiting = [], [pid]
    while waiting:
        family.append(waiting.pop())
        waiting += children.get(family[-1], [])
    return family


def _parent(path: Path) -> int | None:
    try:
        return int((path / "stat").read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):  # it has ended since
        return None


def resident(pid: int) -> int:
    """Bytes in memory; 0 for a process that has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE
    except (FileNotFoundError, ProcessLookupError):
        return 0
