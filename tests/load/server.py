"""Samples of a server's memory and of its answers to /healthz while it works."""

from __future__ import annotations

import http.client
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

EVERY_SECONDS = 0.1
PAGE = 4096
ANSWER_SECONDS = 10


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
