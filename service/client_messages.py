"""Requests and responses of the HTTP API, written and read the same way by both clients. Nothing here waits."""

from __future__ import annotations

import io
import json
import os
import re
import tempfile
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeAlias, TypeVar

import httpx2

from ciir.errors import (
    ConnectionFailed,
    Error,
    InvalidOption,
    NotDone,
    NotFound,
    QueueFull,
    ServiceError,
    Unauthorized,
    Unreadable,
)
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.file_types import index_suffixes
from ciir.renderer.writers.formats import BY_SUFFIX
from ciir.renderer.writers.options import TEXT_FILES, read_text
from ciir.service.errors import find_class
from ciir.service.pipeline.options import FILE_TYPES, KINDS, write_texts

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from httpx2 import ServerSentEvent

    from ciir.service.pipeline.given import File
    from ciir.service.pipeline.options import KindName

    Source: TypeAlias = "File | KeptFile | Result | JobPath"
    """What is taken as the input of a job."""

T = TypeVar("T")
FINAL = frozenset({"done", "failed", "cancelled"})
PAUSE_SECONDS = 1.0
"""Pause before a request is repeated, if the server names no time, and before a stream that ended early is opened
again."""
RECONNECT_PAUSES = (1.0, 2.0, 4.0, 8.0, 15.0, 15.0, 15.0)
"""Pauses in seconds after each broken connection in a row while a job is read: 60 s in all. An update of a single
server takes 4 to 10 s."""
_GATEWAY = frozenset({502, 503, 504})
"""Statuses of a proxy whose server can't be reached."""
_JOB = re.compile(r"/v1/([a-z]+)/([0-9a-f]{32})(?=/|$)")
_BY_STATUS: dict[int, type[Error]] = {401: Unauthorized, 404: NotFound, 409: NotDone}
_FOREIGN = "the response is not from a ciir server; check the URL and any proxy"


@dataclass(frozen=True)
class Result:
    """A result: the file, how long it took, and notes."""

    id: str
    content: bytes = field(repr=False)
    format: str
    """The file's format, such as `png` or `zip`; docs/formats.md lists them all."""
    timings_ms: dict[str, float]
    """Milliseconds of each stage; `stored` if the server had kept the result."""
    name: str
    """The file's name, as given by the server; a quilt's name contains its layout."""
    notes: tuple[str, ...] = ()
    """The notes that the command line prints."""

    def save(self, path: str | Path) -> None:
        """Writes `content` to a file, or as `name` into a folder: an existing one, or a `path` with a slash at its end.

        Missing folders are created. Raises `InvalidOption` for a suffix of another format, and for a place where
        nothing can be written.
        """
        is_folder, path = str(path).endswith("/"), Path(path)
        if is_folder or path.is_dir():
            path /= self.name
        own = FILE_TYPES[self.format].suffixes
        suffix = path.suffix.lower()
        others = index_suffixes(FILE_TYPES.values()) | BY_SUFFIX
        if suffix in others and suffix not in own:
            raise InvalidOption(
                f"{path}: the result is {self.format}; name it {own[0]}, or ask for format={others[suffix].name!r}"
            )
        with replacing(path) as file:
            file.write(self.content)


@dataclass(frozen=True)
class KeptFile:
    """A file that the server keeps, to be used by several requests in place of its path."""

    id: str
    name: str
    """`upload` and the part of the file's name that is used."""
    bytes: int
    path: str | None = field(default=None, compare=False)
    """Where it is sent from again, once it has expired."""


@dataclass(frozen=True)
class Event:
    """An event of a job. Events are numbered from 0."""

    number: int
    kind: str
    """`queued`, `running`, `progress`, `done`, `failed`, `cancelled`."""
    data: dict[str, Any]


class JobPath:
    """The path of a job on its server."""

    def __init__(self, path: str) -> None:
        self.path = path
        """The path, as in `GET`."""
        self.id = path.rpartition("/")[2]


class Cursor:
    """A client's position in a job's events."""

    def __init__(self, path: str, retries: int) -> None:
        self._path, self._retries, self._last, self._failures = path, retries, "", 0
        self.is_at_end = False

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the request for the events that follow."""
        return {"Last-Event-ID": self._last} if self._last else {}

    def begin(self, response: httpx2.Response) -> None:
        """Checks the response, which is 204 if the job has no more events."""
        self.is_at_end = response.status_code == 204

    def take(self, event: ServerSentEvent) -> Event | None:
        """Returns the event as one of the job's, or None for one that only sets `retry`."""
        if not event.data:
            return None
        with _refuse_foreign("event stream"):
            found = Event(int(event.id), event.event, _check(json.loads(event.data), dict))
        self._last, self._failures = event.id, 0
        self.is_at_end = event.event in FINAL
        return found

    def find_pause(self, url: httpx2.URL, error: Exception) -> float:
        """Counts a stream that broke, and returns the seconds until it is opened again, or raises its error."""
        self._failures += 1
        return find_reconnect_pause(url, self._path, error, self._failures, self._retries)


def make_key(api_key: str | None) -> dict[bytes, bytes]:
    """Returns headers with the API key. Raises `InvalidOption` for a key that no header can hold."""
    if api_key is None:
        return {}
    key = api_key.strip()  # as the server does with its own keys: one from a file has a line end
    if not key:
        raise InvalidOption("api_key: is empty; give one of the server's keys, or None if it has none")
    if not key.isprintable():
        raise InvalidOption("api_key: holds a line end or another control character; give one of the server's keys")
    return {b"Authorization": b"Bearer " + key.encode()}


def _check_kind(kind: str) -> None:
    """Raises `InvalidOption` unless it is a kind of job."""
    if kind not in KINDS:
        raise InvalidOption(f"kind: no {kind[:40]!r} here; give one of {', '.join(KINDS)}")


def write_fields(kind: KindName, options: Mapping[str, object]) -> dict[str, str]:
    """Returns the form fields.

    Raises `InvalidOption`, also for an unknown kind and for an option that this kind of job doesn't have, and
    `Unreadable` for an option's file.
    """
    _check_kind(kind)
    known = KINDS[kind].options
    form = options.get("format")
    rest = {name: value for name, value in options.items() if name != "format"}
    texts = {name: read_text(Path(str(rest[name]))) for name in TEXT_FILES if name in rest and name in known}
    return write_texts(rest | texts, known) | ({} if form is None else {"format": str(form)})


def find_path(source: Source) -> str | None:
    """Returns the path of a file that the server has kept, if it is known."""
    return source.path if isinstance(source, KeptFile) else None


def open_source(source: Source) -> tuple[str, str | None, IO[bytes]]:
    """Returns the form's field, the file's name and the content to send. Raises `InputError`.

    The content is a file, or a folder's files as a zip, with the same bytes for the same files, or the name of a
    shipped scene, or the id of a file or result that the server has. A file object is read here, and left open.
    """
    from ciir.renderer.readers.bundle import Folder
    from ciir.service.pipeline.given import read_given
    from ciir.service.pipeline.limits import read_limits
    from ciir.service.pipeline.source import SCENE

    if isinstance(source, KeptFile | Result | JobPath):
        return "file_id", None, io.BytesIO(source.id.encode())
    given = read_given(source)
    if not isinstance(given, str):
        return "file", Path(given[0]).name or "file", io.BytesIO(given[1])
    if given.startswith(SCENE):
        return "scene", None, io.BytesIO(given.removeprefix(SCENE).encode())
    path = Path(given)
    try:
        if not path.is_dir():
            return "file", path.name, path.open("rb")
        packed = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
        with zipfile.ZipFile(packed, "w") as archive:
            for name, data in Folder(path, read_limits()).items():
                archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    except OSError as error:
        raise Unreadable(f"{path}: {error.strerror}; give a file or a folder that can be read") from error
    packed.seek(0)
    return "file", f"{path.resolve().name}.zip", packed


def find_pause(response: httpx2.Response, failures: int, retries: int) -> float:
    """Returns the seconds until a request that has failed `failures` times is repeated, or raises its error.

    Without `Retry-After` a GET is not repeated: the result of a job that failed becomes available only after a new
    POST. Raises `httpx2.RequestError` if a job is read and a proxy can't reach the server.
    """
    if response.status_code in _GATEWAY and not _is_problem(response) and find_job_path(response.request):
        raise httpx2.RequestError(f"{response.status_code} {response.reason_phrase}", request=response.request)
    wait = _read_retry_after(response)
    is_final = wait is None and response.request.method == "GET"
    if failures > retries or response.status_code not in (429, 503) or is_final:
        raise make_error(response)
    return float(wait or PAUSE_SECONDS)


def _read_retry_after(response: httpx2.Response) -> int | None:
    wait = response.headers.get("retry-after", "")
    return int(wait) if wait.isdecimal() else None


def _is_problem(response: httpx2.Response) -> bool:
    """Checks whether a response is a problem, as the server sends; a proxy sends others."""
    return bool(response.headers.get("content-type", "").startswith("application/problem+json"))


def make_error(response: httpx2.Response) -> Error:
    """Returns the error that an unsuccessful response reports."""
    status = response.status_code
    what = f"{status} {response.reason_phrase}"
    if not _is_problem(response):
        return ServiceError(f"{what}: {_FOREIGN}")
    with _refuse_foreign(what):
        problem = response.json()
        title, detail = _check(problem["title"], str), _check(problem["detail"], str)
    kind = find_class(title) or _BY_STATUS.get(status)
    if kind is None:
        return ServiceError(f"{status} {title}: {detail}")
    return QueueFull(detail, _read_retry_after(response) or 1) if kind is QueueFull else kind(detail)


@contextmanager
def _refuse_foreign(what: object) -> Iterator[None]:
    """Raises `ServiceError` instead of the errors from reading what no ciir server sends. `what` begins the message."""
    try:
        yield
    except (LookupError, TypeError, ValueError, RecursionError) as error:
        raise ServiceError(f"{what}: {_FOREIGN}") from error


def _check(value: Any, kind: type[T]) -> T:
    """Returns `value`, which must have that type. Raises `TypeError`."""
    if not isinstance(value, kind):
        raise TypeError(f"{type(value).__name__} in place of {kind.__name__}")
    return value


def find_job_path(request: httpx2.Request) -> str:
    """Returns the path of the job that a request reads; empty for any other request."""
    found = _JOB.search(request.url.path) if request.method == "GET" else None
    return "" if found is None else found[0]


def find_reconnect_pause(url: httpx2.URL, path: str, error: Exception, failures: int, retries: int) -> float:
    """Returns the seconds until a request is repeated whose connection broke `failures` times in a row.

    `url` is the server's, and `path` that of the job that is read. Raises `ConnectionFailed` after the last of
    `RECONNECT_PAUSES`, and at once if no job is read or `retries` is 0.
    """
    pauses = RECONNECT_PAUSES if path and retries else ()
    if failures > len(pauses):
        raise make_connection_error(url, error, path) from error
    return pauses[failures - 1]


def make_connection_error(url: httpx2.URL, error: Exception, path: str = "") -> ConnectionFailed:
    """Returns the error that reports a failure to connect, send or receive; `path` is that of the job, if any."""
    if url.scheme not in ("http", "https"):
        return ConnectionFailed(f"{url}: this is not a server's URL; give one that begins with http:// or https://")
    why = str(error).rstrip(".") or type(error).__name__
    if found := _JOB.fullmatch(path):
        kind = next((name for name, kind in KINDS.items() if kind.plural == found[1]), found[1])
        again = f"client.job({found[2]!r}, {kind!r})"
        return ConnectionFailed(f"{str(url).rstrip('/')}{path}: {why}; go on with {again} once the server is running")
    return ConnectionFailed(f"{url}: {why}; check the URL, and whether the server is running")


def read_status(response: httpx2.Response) -> dict[str, Any]:
    """Returns the job's status in a response.

    Raises `ServiceError` for anything else, like all the following functions.
    """
    with _refuse_foreign(response.status_code):
        status: dict[str, Any] = _check(response.json(), dict)
        _check(status["events"], str)
        return status


def read_models(response: httpx2.Response) -> list[dict[str, Any]]:
    """Returns the list of models in a response."""
    with _refuse_foreign(response.status_code):
        return [_check(model, dict) for model in _check(response.json(), list)]


def read_kept(response: httpx2.Response, source: File) -> KeptFile:
    """Returns the file that the server keeps, as a response describes it, and that was sent from `source`."""
    path = os.fsdecode(source) if isinstance(source, str | os.PathLike) else None
    with _refuse_foreign(response.status_code):
        found = _check(response.json(), dict)
        return KeptFile(_check(found["id"], str), _check(found["name"], str), _check(found["bytes"], int), path)


def read_path(response: httpx2.Response) -> str:
    """Returns the path of the job whose status is in a response."""
    events: str = read_status(response)["events"]
    found = re.fullmatch(r"(/v1/[a-z]+/[0-9a-f]{32})/events", events)
    if found is None:
        raise ServiceError(f"{response.status_code}: {_FOREIGN}")
    return found[1]


def make_path(id_: str, kind: KindName) -> str:
    """Returns the path of a job. Raises `InvalidOption`."""
    _check_kind(kind)
    if re.fullmatch("[0-9a-f]{32}", id_) is None:
        raise InvalidOption(f"id: {id_[:40]!r} is not a job's id; give the 32 digits of Job.id or of its path")
    return f"/v1/{KINDS[kind].plural}/{id_}"


def read_inspection(result: Result) -> dict[str, Any]:
    """Returns what an inspection found."""
    with _refuse_foreign("inspection"):
        found: dict[str, Any] = _check(json.loads(result.content), dict)
        return found


def read_result(response: httpx2.Response) -> Result:
    """Returns the result in a response."""
    with _refuse_foreign(response.status_code):
        parts = [part.split(";dur=") for part in response.headers.get("server-timing", "").split(", ") if part]
        file = Path(response.headers["content-disposition"].rstrip('"').rpartition('"')[2])
        timings = {stage: float(ms) for stage, ms in parts}
        format_ = index_suffixes(FILE_TYPES.values())[file.suffix].name
        id_ = response.headers["etag"].removeprefix("W/").strip('"').partition("-")[0]
        notes = tuple(_check(json.loads(response.headers.get("x-notes", "[]")), list))
        return Result(id_, response.content, format_, timings, file.name, notes)
