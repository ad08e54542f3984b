"""Mutated files, forms and heads over HTTP, at a real server.

    python -m tests.fuzz.over_http [--inputs 10000] [--seconds 600] [--connections 4] [--seed 1]

A third each: the seeds of all targets, edited, as the file of a whole form; edited forms; and edited requests from the
first byte of the head on. Starts `ciir serve` with a folder of its own.

Every answer must be one that the API declares (no 500), every error a line of problem+json, each within
`ANSWER_SECONDS`; no input may end a worker process, and /healthz must answer at the end. Counts by status; exit status
1 where one of these does not hold.
"""

from __future__ import annotations

import argparse
import collections
import http.client
import json
import random
import socket
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from tests.fuzz import seeds
from tests.fuzz.mutate import mutate
from tests.fuzz.targets import TARGETS
from tests.load.requests import PATH, LoadRequest, make_form
from tests.support.servers import run_server

ANSWER_SECONDS = 60
SUFFIXES = {
    "png-sealed": ".png",
    "jpeg": ".jpg",
    "tiff": ".tif",
    "draco": ".glb",
    "meshopt": ".glb",
    "gltf-pose": ".gltf",
    "any": "",
    "views": ".zip",
}
"""Of a target's files, where it isn't the target's name."""
HEADS = (
    f"POST {PATH}\r\nContent-Type: multipart/form-data; boundary=bound\r\n",
    "GET /v1/reconstructions/0123456789abcdef0123456789abcdef/events\r\nLast-Event-ID: 3\r\n",
    f"POST {PATH}\r\nPrefer: wait=1, respond-async\r\nTransfer-Encoding: chunked\r\n",
    'GET /v1/models\r\nIf-None-Match: "a"\r\nX-Request-Id: abc\r\nAuthorization: Bearer x\r\n',
    f"DELETE {PATH}/../../healthz?a=%00%ff\r\n",
)
"""Without version and Host."""
DECLARED = {200, 202, 204, 304, 400, 401, 403, 404, 405, 408, 409, 410, 413, 415, 422, 429, 431, 503}
INSPECTIONS = "/v1/inspections"
_FORM = {"Content-Type": f"multipart/form-data; boundary={seeds.BOUNDARY.decode()}"}


class Answer(NamedTuple):
    """An answer, as far as there was one."""

    status: int
    """0: the connection was closed without an answer, which only a broken head may cause."""
    error: str = ""
    """What is wrong with the answer; empty for nothing."""


class Attacker:
    """One connection after the other, and inputs made by chance."""

    def __init__(self, host: str, port: int, seed: str) -> None:
        self._host, self._port = host, port
        self._random = random.Random(seed)  # noqa: S311 - the same each time is the point
        self._http = http.client.HTTPConnection(host, port, timeout=ANSWER_SECONDS)
        self._files = [
            (SUFFIXES.get(name, f".{name}"), file)
            for name, target in TARGETS.items()
            if not name.startswith(("options", "multipart", "gltf-values"))
            for file in target.seeds()
        ]

    def send(self) -> Answer:
        """One input; `OSError` where no answer came in time."""
        return self._random.choice((self._file, self._broken_form, self._broken_request))()

    def close(self) -> None:
        """No more is sent."""
        self._http.close()

    def _file(self) -> Answer:
        suffix, file = self._random.choice(self._files)
        options = {"lenses": "4x4", "pixels": "3x3", "model": "none"}
        given = dict(self._random.sample(sorted(options.items()), self._random.randint(0, 3)))
        body = make_form(LoadRequest("file", f"a{suffix}", mutate(file, self._random), given))
        boundary = body[2 : body.index(b"\r\n")].decode()
        return self._post(body, {"Content-Type": f"multipart/form-data; boundary={boundary}"})

    def _broken_form(self) -> Answer:
        return self._post(mutate(self._random.choice(seeds.multipart()), self._random), _FORM)

    def _post(self, body: bytes, headers: dict[str, str]) -> Answer:
        prefer = self._random.choice(({}, {}, {"Prefer": "respond-async"}))
        self._http.request("POST", self._random.choice((PATH, PATH, INSPECTIONS)), body, headers | prefer)
        answer = self._http.getresponse()
        return _check_answer(answer, answer.read())

    def _broken_request(self) -> Answer:
        body = self._random.choice(seeds.multipart())
        line, _, headers = self._random.choice(HEADS).partition("\r\n")
        length = "" if "Transfer-Encoding" in headers else f"Content-Length: {len(body)}\r\n"
        head = f"{line} HTTP/1.1\r\nHost: localhost\r\n{headers}{length}Connection: close\r\n\r\n".encode()
        with socket.create_connection((self._host, self._port), ANSWER_SECONDS) as connection:
            try:
                connection.sendall(mutate(head, self._random) + body)
                connection.shutdown(socket.SHUT_WR)
                with closing(http.client.HTTPResponse(connection)) as answer:
                    answer.begin()
                    return _check_answer(answer, answer.read())
            except (http.client.HTTPException, ConnectionError):
                return Answer(0)


def _check_answer(answer: http.client.HTTPResponse, body: bytes) -> Answer:
    if answer.status not in DECLARED:
        return Answer(answer.status, f"{answer.status} is no declared answer: {body[:200]!r}")
    if answer.status >= 400 and answer.headers["Content-Type"] != "application/problem+json":
        return Answer(answer.status, f"{answer.status} without a problem: {body[:200]!r}")
    if answer.status >= 400 and body and not json.loads(body)["detail"].isprintable():
        return Answer(answer.status, f"{answer.status} whose detail is no line: {body[:200]!r}")
    return Answer(answer.status)


def attack(host: str, port: int, *, inputs: int, seconds: float, connections: int, seed: int) -> list[Answer]:
    """The answers, in no order."""
    end, lock, left = time.monotonic() + seconds, threading.Lock(), inputs

    def take() -> bool:
        nonlocal left
        with lock:
            left -= 1
            return left >= 0 and time.monotonic() < end

    def work(number: int) -> list[Answer]:
        with closing(Attacker(host, port, f"{seed}-{number}")) as attacker:
            return [attacker.send() for _ in iter(take, False)]

    with ThreadPoolExecutor(connections) as pool:
        return [answers for part in pool.map(work, range(connections)) for answers in part]


def list_deaths(log: Path) -> list[str]:
    """The lines of a server's log on runs that ended their worker process."""
    return [line for line in log.read_text().splitlines() if " s the worker process " in line]


def main() -> int:
    """Prints the counts."""
    parser = argparse.ArgumentParser(prog="tests.fuzz.over_http", description=main.__doc__)
    parser.add_argument("--inputs", type=int, default=10_000, help="how many (default 10000)")
    parser.add_argument("--seconds", type=float, default=600, help="after which no more are sent (default 600)")
    parser.add_argument("--connections", type=int, default=4, help="parallel connections (default 4)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    given = parser.parse_args()
    host = "127.0.0.1"
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "log")
        with run_server(log, CIIR_FOLDER=f"{folder}/service") as server:
            options = {name: getattr(given, name) for name in ("inputs", "seconds", "connections", "seed")}
            answers = attack(host, server.port, **options)
            with closing(http.client.HTTPConnection(host, server.port, timeout=ANSWER_SECONDS)) as connection:
                connection.request("GET", "/healthz")
                is_alive = connection.getresponse().status == 200
        deaths = list_deaths(log)
    counts = collections.Counter(one.status for one in answers)
    errors = [one.error for one in answers if one.error]
    print(f"{len(answers):,} inputs: " + ", ".join(f"{status}: {count:,}" for status, count in sorted(counts.items())))
    print(f"{len(errors)} answers that are not as declared", *errors[:10], sep="\n")
    print(f"{len(deaths)} runs that ended their worker process", *deaths[:10], sep="\n")
    print(f"/healthz answers at the end: {is_alive}")
    return 0 if is_alive and not errors and not deaths else 1


if __name__ == "__main__":
    sys.exit(main())
