"""A client of `benchmarks.load`: one connection, and a request asked for until it is answered."""

from __future__ import annotations

import http.client
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.load_requests import Asked

PATH = "/v1/reconstructions"
BOUNDARY = "--------------------------ciir-load"
ANSWER_SECONDS = 600
"""For each answer, and for all rounds of a request together."""
LATER = {409, 429, 503}
"""Statuses that come with `Retry-After` where the server wants to be asked again."""


@dataclass(frozen=True)
class Answered:
    """What the server said to a request in the end."""

    status: int
    ms: float
    """From the first byte sent to the last one received, of all rounds together."""
    pipeline_ms: float | None
    """The pipeline's own time, as the answer tells it."""
    said: tuple[int, ...]
    """Every status, in order."""


class Connection:
    """A connection to the server that is kept open, as a browser's is."""

    def __init__(self, port: int) -> None:
        self._http = http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_SECONDS)

    def ask(self, body: bytes) -> tuple[Answered, bytes]:
        """The answer to a `form`, and its body, after as many rounds as the server asks for.

        Raises `OSError` or `HTTPException` where there is none.
        """
        method, path = "POST", PATH
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
        said: list[int] = []
        begun = time.perf_counter()
        while True:
            self._http.request(method, path, body if method == "POST" else None, headers if method == "POST" else {})
            answer = self._http.getresponse()
            content = answer.read()
            said.append(answer.status)
            if answer.status == 202:
                method, path = "GET", f"{answer.headers['Location']}/result"
            elif answer.status not in LATER or "Retry-After" not in answer.headers:
                break
            if time.perf_counter() - begun > ANSWER_SECONDS:
                break
            time.sleep(float(answer.headers.get("Retry-After", 1)))
        took = 1000 * (time.perf_counter() - begun)
        timing = re.search(r"\btotal;dur=([\d.]+)", answer.headers.get("Server-Timing", ""))
        return Answered(answer.status, took, float(timing[1]) if timing else None, tuple(said)), content

    def close(self) -> None:
        """No more is asked."""
        self._http.close()


def form(given: Asked) -> bytes:
    """The multipart body."""
    head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="'
    fields = "".join(f'{head}{name}"\r\n\r\n{value}\r\n' for name, value in given.options.items())
    file = f'{fields}{head}file"; filename="{given.name}"\r\nContent-Type: application/octet-stream\r\n\r\n'
    return file.encode() + given.data + f"\r\n--{BOUNDARY}--\r\n".encode()
