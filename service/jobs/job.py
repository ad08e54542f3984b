"""What is known of a job, as JSON can hold it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

Lane = Literal["small", "large"]
State = Literal["queued", "running", "done", "failed", "cancelled"]
FINAL: frozenset[State] = frozenset({"done", "failed", "cancelled"})
"""States that no job leaves, but by being asked for again."""


@dataclass(frozen=True)
class Request:
    """What a client asked for, but for the file itself."""

    name: str
    """`upload` and the suffix of the client's file name: `upload.glb`."""
    options: dict[str, str]
    """As text, by the names of `service.pipeline.options.NAMES`; already parsed once, so known to be in range."""
    format: str | None
    """`png`, `zip`, `npz`; None: png where one view is asked for, else zip."""


@dataclass(frozen=True)
class Problem:
    """Why a job failed: the members of an RFC 9457 problem that don't depend on where it is asked for."""

    status: int
    title: str
    detail: str


@dataclass(frozen=True)
class Result:
    """What a job that is done has to give, beside its file."""

    format: str
    size: int
    """Bytes."""
    report: dict[str, Any]
    """`service.pipeline.report.Report` without its `views`, which a zip and an npz hold."""


@dataclass(frozen=True)
class Event:
    """Something that happened; events of a job are numbered from 0, and never change or go while the job is kept.

    A job that is asked for again after it failed or was cancelled begins anew, from event 0.
    """

    kind: Literal["queued", "running", "progress", "done", "failed", "cancelled"]
    data: dict[str, Any] = field(default_factory=dict)
    """`progress`: `{"stage": "decode|plan|render|map|upscale|encode", "views_done": int, "views": int}`."""


@dataclass(frozen=True)
class Job:
    """A job as it stands; replaced whole whenever something happens to it."""

    id: str
    """32 hexadecimal digits: the hash of input, options, network and version (`service.jobs.identity`)."""
    request: Request
    state: State = "queued"
    created: float = 0.0
    """Seconds since 1970, by the clock on the wall: for people; nothing is decided by it."""
    attempts: int = 0
    """How often its work was begun."""
    deaths: int = 0
    """How many worker processes died of it."""
    lane: Lane = "small"
    """The queue it waits in: `service.jobs.lanes`."""
    input: str = ""
    """The input's name among the files, `id.` and some digits of its own; None other has it, however often the same is
    asked for."""
    claim: str = ""
    """Of the last run: which consumer, and which of its runs; no other run has it."""
    events: tuple[Event, ...] = ()
    problem: Problem | None = None
    """Of a job that failed."""
    result: Result | None = None
    """Of a job that is done."""

    @property
    def output(self) -> str:
        """The result's name among the files; no two runs share one."""
        return f"{self.id}.{self.claim}"

    def after(self, event: Event, **changes: Any) -> Job:
        """The job once `event` has happened."""
        return replace(self, events=(*self.events, event), **changes)

    def to_bytes(self) -> bytes:
        """UTF-8 JSON."""
        return json.dumps(asdict(self), separators=(",", ":"), allow_nan=False).encode()

    @classmethod
    def from_bytes(cls, text: bytes) -> Job:
        """What `to_bytes` wrote. Raises `ValueError`, `LookupError` or `TypeError` where it is something else."""
        held = json.loads(text)
        problem, result = held.pop("problem"), held.pop("result")
        return cls(
            **held | {"request": Request(**held["request"]), "events": tuple(Event(**e) for e in held["events"])},
            problem=None if problem is None else Problem(**problem),
            result=None if result is None else Result(**result),
        )
