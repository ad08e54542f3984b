"""The record of a job, which is stored as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, cast

from ciir.service.jobs.resource import DISK_FULL

if TYPE_CHECKING:
    from ciir.service.pipeline.options import KindName

Lane = Literal["small", "large"]
State = Literal["queued", "running", "done", "failed", "cancelled"]
EventKind = Literal["queued", "running", "progress", "done", "failed", "cancelled"]
FINAL: frozenset[State] = frozenset({"done", "failed", "cancelled"})
"""States that a job only leaves when it is submitted again."""
KEPT_FILE = cast("KindName", "file")
"""In place of the kind, in the record of a file that is kept for several requests: an ended job whose result is that
file."""
LONG_TEXT = 1000
"""An option's text that is longer is stored once, although the report of the result repeats it."""
CLIENTS_LIMIT = 100
"""Most clients that a job's record lists. Requests by further clients are not listed."""


@dataclass(frozen=True)
class Request:
    """A client's request without the file."""

    name: str
    """`upload` with the suffix of the client's file name, `upload.glb`; before the suffix comes the part that marks a
    picture as a quilt or ESLF, `upload_qs8x6a0.75.png`. Or `scene:NAME`, whose file is empty."""
    options: dict[str, str]
    """Option texts by the names of `service.pipeline.options.NAMES`. They have been parsed once, so they are in
    range."""
    format: str | None
    """Output format, or None for that of `service.pipeline.options.Kind.default_format`."""
    kind: KindName = "reconstruction"


@dataclass(frozen=True)
class Problem:
    """Why a job failed: the members of an RFC 9457 problem that do not depend on the URL."""

    status: int
    title: str
    detail: str


INTERNAL_ERROR = Problem(500, "Internal error", "the job failed; the server's log says why")
NO_ROOM = Problem(503, "No room", DISK_FULL)


@dataclass(frozen=True)
class Result:
    """The result of a finished job, without the file itself."""

    format: str
    size: int
    """Bytes of the file."""
    report: dict[str, Any]
    """`service.pipeline.report.Report` without its `views`, which a zip and an npz contain."""
    sha256: str = ""
    """SHA-256 of the file; empty until it is published. A file with another size or SHA-256 is never sent."""
    views: int = 0
    """Number of views; 1 for a picture, 0 in a record from an older version."""


@dataclass(frozen=True)
class Event:
    """Something that happened to a job. Events are numbered from 0 and never change while the record exists.

    A job that is submitted again after it failed or was cancelled starts again at event 0.
    """

    kind: EventKind
    data: dict[str, Any] = field(default_factory=dict)
    """`progress`: `{"stage": service.pipeline.report.Stage, "views_done": int, "views": int}`."""


@dataclass(frozen=True)
class Job:
    """The state of a job. Every change makes a new object."""

    id: str
    """32 hexadecimal digits (`service.jobs.identity`)."""
    request: Request
    state: State = "queued"
    created: float = 0.0
    """Seconds since 1970, only for users and metrics, like `started`."""
    started: float = 0.0
    """When the last run started."""
    attempts: int = 0
    """Number of runs that were started."""
    worker_deaths: int = 0
    """Number of worker processes that died or were ended during a run."""
    has_timed_out: bool = False
    """Whether one of them was ended because it took all the time that a job has."""
    clients: tuple[str, ...] = ()
    """Digests of the clients that asked for the job and did not cancel it; empty in a record from an older version."""
    lane: Lane = "small"
    """The queue that it waits in (`service.jobs.lanes`)."""
    request_id: str = "-"
    """Id of the HTTP request that submitted it, for the log; `-` in a record from an older version."""
    input: str = ""
    """Name of the input file: the id, a dot and random digits, new for each submission."""
    content: str = ""
    """SHA-256 of the input, which each run checks; empty in a record from an older version."""
    lease: str = ""
    """The last run's claim on the job: the consumer's name and a number, unique to the run."""
    events: tuple[Event, ...] = ()
    problem: Problem | None = None
    """Set if the job failed."""
    result: Result | None = None
    """Set if the job is done."""
    made_by: str = ""
    """`identity.hash_installation()` of the worker that ended the job; empty until then, and in a record from an older
    version."""

    @property
    def output(self) -> str:
        """Name of the result file, unique to the run."""
        return f"{self.id}.{self.lease}"

    def add_client(self, client: str) -> Job:
        """Returns the job with one more client, unless the client or `CLIENTS_LIMIT` others are listed."""
        if client in self.clients or len(self.clients) >= CLIENTS_LIMIT:
            return self
        return replace(self, clients=(*self.clients, client))

    def list_others(self, client: str) -> tuple[str, ...]:
        """Lists the clients other than `client`."""
        return tuple(other for other in self.clients if other != client)

    def add_event(self, event: Event, **changes: Any) -> Job:
        """Returns the job with one more event and other changes of attributes."""
        return replace(self, events=(*self.events, event), **changes)

    def to_bytes(self) -> bytes:
        """Returns the job as UTF-8 JSON."""
        fields = asdict(self)
        if self.result is not None:
            repeated = fields["result"]["report"].get("options", {})
            repeated |= {name: None for name, text in self._list_long_texts() if repeated.get(name) == text}
        if not self.made_by:
            del fields["made_by"]  # so that workers of versions without it can take the job
        return json.dumps(fields, separators=(",", ":"), allow_nan=False).encode()

    @classmethod
    def from_bytes(cls, text: bytes) -> Job:
        """Parses the output of `to_bytes`, ignoring attributes that a newer version added.

        Raises `ValueError`, `LookupError`, `TypeError` or `AttributeError` for anything else.
        """
        fields = dict(json.loads(text))
        for key in fields.keys() - cls.__dataclass_fields__:
            del fields[key]
        problem, result = fields.pop("problem"), fields.pop("result")
        events, clients = tuple(Event(**event) for event in fields["events"]), tuple(fields.get("clients", ()))
        job = cls(
            **fields | {"request": Request(**fields["request"]), "events": events, "clients": clients},
            problem=None if problem is None else Problem(**problem),
            result=None if result is None else Result(**result),
        )
        if job.result is not None:
            repeated = job.result.report.get("options", {})
            repeated |= {name: text for name, text in job._list_long_texts() if repeated.get(name, "") is None}
        return job

    def _list_long_texts(self) -> list[tuple[str, str]]:
        """Lists the client's options that are long, by name."""
        return [(name, text) for name, text in self.request.options.items() if len(text) > LONG_TEXT]


def parse_id(name: str) -> str:
    """Returns the job's id from the name of its input or result file."""
    return name.partition(".")[0]
