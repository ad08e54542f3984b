"""Python client of the HTTP API.

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
from typing import TYPE_CHECKING, Any

import httpx2

from ciir.errors import Error

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ROOT = "/v1/reconstructions"
FINAL = frozenset({"done", "failed", "cancelled"})
TIMEOUT_SECONDS = 60.0
"""Longest silence of the server; it sends at least a comment every 15 s while a job runs."""


class ServiceError(Error):
    """The server answered with an error: an RFC 9457 problem."""

    def __init__(self, status: int, title: str, detail: str, retry_after: float | None = None) -> None:
        super().__init__(f"{status} {title}: {detail}")
        self.status, self.title, self.detail = status, title, detail
        self.retry_after = retry_after
        """Seconds after which to try again; None if that is of no use."""


class BadRequest(ServiceError):  # noqa: N818 - the cause is the name
    """400, 408: the request is broken, or came too slowly."""


class Unauthorized(ServiceError):  # noqa: N818
    """401: the API key is missing or wrong."""


class NotFound(ServiceError):  # noqa: N818
    """404, 410: there is no such job, or its result has expired."""


class NotDone(ServiceError):  # noqa: N818
    """409: the job waits, runs, or was cancelled."""


class InvalidInput(ServiceError):  # noqa: N818
    """413, 415, 422: the file or an option is wrong."""


class QueueFull(ServiceError):  # noqa: N818
    """429: too many jobs wait."""


class Unavailable(ServiceError):  # noqa: N818
    """503: the server is starting or stopping, or its queue cannot be reached."""


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
    """A result: the views and how long they took."""

    id: str
    content: bytes
    """One PNG, a zip with `report.json`, or an npz."""
    format: str
    """`png`, `zip` or `npz`."""
    timings_ms: dict[str, float]
    """Milliseconds of each stage; `stored` if the server had kept the result."""

    def save(self, path: str | Path) -> None:
        """Writes `content` to a file."""
        Path(path).write_bytes(self.content)


@dataclass(frozen=True)
class Event:
    """An event of a job; numbered from 0."""

    number: int
    kind: str
    """`queued`, `running`, `progress`, `done`, `failed`, `cancelled`."""
    data: dict[str, Any]


class Client(httpx2.Client):
    """A connection to the server at `url`. Not to be shared between threads.

    All methods raise `ServiceError`, or `httpx2.TransportError` if the server can't be reached.
    """

    def __init__(
        self,
        url: str,
        api_key: str | None = None,
        *,
        retries: int = 5,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        """`retries`: how often a request is repeated after 429 or 503, each time after the server's `Retry-After`."""
        headers = {} if api_key is None else {"Authorization": f"Bearer {api_key}"}
        super().__init__(base_url=url, headers=headers, timeout=TIMEOUT_SECONDS, transport=transport)
        self.retries = retries

    def send(self, request: httpx2.Request, **options: Any) -> httpx2.Response:
        """Sends any request of this client, and repeats it up to `retries` times."""
        failures = 0
        while not (response := super().send(request, **options)).is_success:
            response.read()
            error = make_error(response)
            failures += 1
            if failures > self.retries or not isinstance(error, QueueFull | Unavailable):
                raise error
            time.sleep(error.retry_after or 1.0)
        return response

    def reconstruct(self, path: str | Path, **options: object) -> Result:
        """Sends the file at `path` and waits for its views. `options`: the form fields of `POST`."""
        response = self._post(path, options, {})
        if response.status_code == 200:
            return _parse_result(response)
        return Job(self, response.json()["id"]).result()

    def submit(self, path: str | Path, **options: object) -> Job:
        """Sends the file at `path` and returns its job without waiting. Options as in `reconstruct`."""
        response = self._post(path, options, {"Prefer": "respond-async"})
        return Job(self, response.json()["id"])

    def models(self) -> list[dict[str, Any]]:
        """Lists the models of the server."""
        models: list[dict[str, Any]] = self.get("/v1/models").json()
        return models

    def _post(self, path: str | Path, options: Mapping[str, object], headers: Mapping[str, str]) -> httpx2.Response:
        path = Path(path)
        fields = {name: str(value) for name, value in options.items() if value is not None}
        with path.open("rb") as file:
            return self.post(ROOT, files={"file": (path.name, file)}, data=fields, headers=headers)


class Job:
    """A job of a server."""

    def __init__(self, client: Client, id_: str) -> None:
        self._client = client
        self.id = id_
        self.path = f"{ROOT}/{id_}"

    def status(self) -> dict[str, Any]:
        """The job's status, as `GET /v1/reconstructions/{id}` answers it."""
        status: dict[str, Any] = self._client.get(self.path).json()
        return status

    def events(self) -> Iterator[Event]:
        """Yields all events from the first to the last. Reconnects up to `retries` times in a row."""
        last, failures = "", 0
        while True:
            headers = {"Last-Event-ID": last} if last else {}
            try:
                with self._client.sse(f"{self.path}/events", headers=headers) as events:
                    if events.response.status_code == 204:
                        return
                    for event in events:
                        if not event.data:  # it only sets `retry`
                            continue
                        last, failures = event.id, 0
                        yield Event(int(event.id), event.event, json.loads(event.data))
                        if event.event in FINAL:
                            return
            except httpx2.TransportError:
                failures += 1
                if failures > self._client.retries:
                    raise
            time.sleep(1.0)

    def result(self) -> Result:
        """Waits for the result. Raises `ServiceError` if the job fails or is cancelled."""
        for _ in self.events():
            pass
        return _parse_result(self._client.get(f"{self.path}/result"))

    def cancel(self) -> dict[str, Any]:
        """Cancels the job, or removes one that has ended, and returns its last status."""
        status: dict[str, Any] = self._client.delete(self.path).json()
        return status


def make_error(response: httpx2.Response) -> ServiceError:
    """The error that a response without success reports."""
    wait = response.headers.get("retry-after", "")
    retry_after = float(wait) if wait.isdecimal() else None
    title, detail = response.reason_phrase, "the response is not from a ciir server; check the URL and any proxy"
    if response.headers.get("content-type", "").startswith("application/problem+json"):
        problem = response.json()
        title, detail = problem["title"], problem["detail"]
    kind = _KINDS.get(response.status_code, ServiceError)
    return kind(response.status_code, title, detail, retry_after)


def _parse_result(response: httpx2.Response) -> Result:
    parts = [part.split(";dur=") for part in response.headers.get("server-timing", "").split(", ") if part]
    form = response.headers["content-disposition"].rstrip('"').rpartition(".")[2]
    timings = {stage: float(ms) for stage, ms in parts}
    return Result(response.headers["x-reconstruction-id"], response.content, form, timings)
