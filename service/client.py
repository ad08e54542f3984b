"""A client of the HTTP API, for Python programs.

with Client("http://127.0.0.1:8000") as client:
    client.reconstruct("duck.glb", lenses="50x50").save("view.png")
    job = client.submit("eia.png", lenses="50x50", views="all", format="npz")
    for event in job.events():
        print(event.kind, event.data)
    views = job.result().content
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import httpx2

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from types import TracebackType

ROOT = "/v1/reconstructions"
FINAL = frozenset({"done", "failed", "cancelled"})
TIMEOUT_SECONDS = 60.0
"""How long the server may say nothing; it answers sooner by itself, if only that a job goes on."""


class ServiceError(Exception):
    """What the server answered in place of what was asked for: an RFC 9457 problem."""

    def __init__(self, status: int, title: str, detail: str, retry_after: float | None = None) -> None:
        super().__init__(f"{status} {title}: {detail}")
        self.status, self.title, self.detail = status, title, detail
        self.retry_after = retry_after
        """Seconds; None where it is no use to try again."""


class BadRequest(ServiceError):  # noqa: N818 - the cause is the name
    """400, 408: the request was broken, or too slow."""


class Unauthorized(ServiceError):  # noqa: N818
    """401: the server wants an API key, or another one."""


class NotFound(ServiceError):  # noqa: N818
    """404, 410: there is no such job, or its result is kept no longer."""


class NotDone(ServiceError):  # noqa: N818
    """409: the job is not done: it waits, it runs, or it was cancelled."""


class InvalidInput(ServiceError):  # noqa: N818
    """413, 415, 422: the file or an option is at fault; the same again gives the same."""


class QueueFull(ServiceError):  # noqa: N818
    """429: too many jobs wait."""


class Unavailable(ServiceError):  # noqa: N818
    """503: the server is starting or stopping, or is without its queue."""


_KINDS: dict[int, type[ServiceError]] = {
    400: BadRequest,
    401: Unauthorized,
    404: NotFound,
    408: BadRequest,
    409: NotDone,
    410: NotFound,
    413: InvalidInput,
    415: InvalidInput,
    422: InvalidInput,
    429: QueueFull,
    503: Unavailable,
}


@dataclass(frozen=True)
class Result:
    """The views."""

    id: str
    content: bytes
    """One PNG, a zip with `report.json`, or an npz."""
    format: str
    """`png`, `zip` or `npz`."""
    timings_ms: dict[str, float]
    """Milliseconds of each stage; `stored` where the server had the result already."""

    def save(self, path: str | Path) -> None:
        """Writes `content` to a file."""
        Path(path).write_bytes(self.content)


@dataclass(frozen=True)
class Event:
    """Something that happened to a job; numbered from 0."""

    number: int
    kind: str
    """`queued`, `running`, `progress`, `done`, `failed`, `cancelled`."""
    data: dict[str, Any]


class Client:
    """A server at `url`. Not to be shared by threads. A context manager that closes its connections."""

    def __init__(
        self,
        url: str,
        api_key: str | None = None,
        *,
        retries: int = 5,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        """`retries`: how often a request is sent again that was answered with 429 or 503, after the time that the
        server says.
        """
        headers = {} if api_key is None else {"Authorization": f"Bearer {api_key}"}
        self._http = httpx2.Client(base_url=url, headers=headers, timeout=TIMEOUT_SECONDS, transport=transport)
        self.retries = retries

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def reconstruct(self, path: str | Path, **options: object) -> Result:
        """The views of the file at `path`, however long it takes. `options`: those of `POST /v1/reconstructions`, and
        `format`. Raises a `ServiceError`; where the server can't be reached, an `httpx2.TransportError`.
        """
        response = self._post(path, options, {})
        if response.status_code == 200:
            return _result(response)
        return Job(self, response.json()["id"]).result()

    def submit(self, path: str | Path, **options: object) -> Job:
        """The same as a job, which the server does by itself. Raises as `reconstruct`."""
        response = self._post(path, options, {"Prefer": "respond-async"})
        return Job(self, response.json()["id"])

    def models(self) -> list[dict[str, Any]]:
        """The models that can be named."""
        listed: list[dict[str, Any]] = self.request("GET", "/v1/models").json()
        return listed

    def request(self, method: str, path: str, headers: Mapping[str, str] | None = None) -> httpx2.Response:
        """Any request without a body. Raises as `reconstruct`."""
        return self._send(lambda: self._http.request(method, path, headers=headers))

    def stream(self, path: str, headers: Mapping[str, str]) -> Any:
        """A context manager: the answer to a GET, whose lines come as they are sent."""
        return self._http.stream("GET", path, headers=headers)

    def _post(self, path: str | Path, options: Mapping[str, object], headers: Mapping[str, str]) -> httpx2.Response:
        path = Path(path)
        fields = {name: str(value) for name, value in options.items() if value is not None}

        def post() -> httpx2.Response:
            with path.open("rb") as file:
                return self._http.post(ROOT, files={"file": (path.name, file)}, data=fields, headers=headers)

        return self._send(post)

    def _send(self, send: Callable[[], httpx2.Response]) -> httpx2.Response:
        for left in range(self.retries, -1, -1):
            response = send()
            if response.is_success:
                return response
            error = make_error(response)
            if not left or not isinstance(error, QueueFull | Unavailable):
                raise error
            time.sleep(error.retry_after or 1.0)
        raise AssertionError  # the last turn returns or raises


class Job:
    """A reconstruction that a server does, or did."""

    def __init__(self, client: Client, id_: str) -> None:
        self._client = client
        self.id = id_
        self.path = f"{ROOT}/{id_}"

    def status(self) -> dict[str, Any]:
        """As `GET /v1/reconstructions/{id}` tells it: `state`, `progress`, and `report` or `problem` at its end."""
        found: dict[str, Any] = self._client.request("GET", self.path).json()
        return found

    def events(self) -> Iterator[Event]:
        """All that happened and happens to it, until it has ended. A stream that breaks off is taken up again, unless
        that fails as often in a row as the client tries anything.
        """
        last, failures = -1, 0
        while True:
            headers = {"Last-Event-ID": str(last)} if last >= 0 else {}
            try:
                with self._client.stream(f"{self.path}/events", headers) as response:
                    if response.status_code == 204:
                        return
                    if not response.is_success:
                        response.read()
                        raise make_error(response)
                    for event in _events(response.iter_lines()):
                        last, failures = event.number, 0
                        yield event
                        if event.kind in FINAL:
                            return
            except (httpx2.TransportError, Unavailable):
                failures += 1
                if failures > self._client.retries:
                    raise
            time.sleep(1.0)

    def result(self) -> Result:
        """The views, once it is done. Raises a `ServiceError` where it failed or was cancelled."""
        for _ in self.events():
            pass
        return _result(self._client.request("GET", f"{self.path}/result"))

    def cancel(self) -> dict[str, Any]:
        """Its status, `cancelled` unless it has ended before."""
        found: dict[str, Any] = self._client.request("DELETE", self.path).json()
        return found


def make_error(response: httpx2.Response) -> ServiceError:
    """What an answer that isn't one of success tells."""
    wait = response.headers.get("retry-after", "")
    retry_after = float(wait) if wait.isdecimal() else None
    title, detail = response.reason_phrase, "what answered is no ciir server; look at the URL, and what is before it"
    if response.headers.get("content-type", "").startswith("application/problem+json"):
        told = response.json()
        title, detail = told["title"], told["detail"]
    kind = _KINDS.get(response.status_code, ServiceError)
    return kind(response.status_code, title, detail, retry_after)


def _result(response: httpx2.Response) -> Result:
    parts = [part.split(";dur=") for part in response.headers.get("server-timing", "").split(", ") if part]
    form = response.headers["content-disposition"].rstrip('"').rpartition(".")[2]
    timings = {stage: float(ms) for stage, ms in parts}
    return Result(response.headers["x-reconstruction-id"], response.content, form, timings)


def _events(lines: Iterator[str]) -> Iterator[Event]:
    """Of a `text/event-stream`: fields up to an empty line; what begins with a colon is no event."""
    fields: dict[str, str] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(":")
            fields[name] = value.removeprefix(" ")
        else:
            if "event" in fields:
                yield Event(int(fields["id"]), fields["event"], json.loads(fields["data"]))
            fields = {}
