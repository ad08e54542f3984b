"""The messages of worker processes, with checks, because a malicious input may take over a worker process."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter

from ciir.service.jobs.job import Problem, Result
from ciir.service.pipeline.options import FILE_TYPES
from ciir.service.pipeline.report import STAGES, Stage

LIMIT = 1 << 20
"""Most bytes of a message. A report has a few thousand."""

_MOST = 10**12
"""The largest value of each number that the parent relies on."""
_DIGITS = 19
"""Most digits of any integer."""
_MOST_TEXT = 4000
"""Most characters of a problem's text; longer ones are cut."""
_COUNTED = {"pixels", "uniform"}
"""What `Metrics.count_result` adds up: all of them are present, or none."""


def _check_outcome(outcome: Result | Problem) -> Result | Problem:
    """Checks what else the parent relies on: metrics and headers use the report's numbers."""
    if isinstance(outcome, Problem):
        if not 400 <= outcome.status <= 599:
            raise ValueError("not the status of an error")
        return Problem(outcome.status, _clean(outcome.title), _clean(outcome.detail))
    if not 0 <= outcome.size <= _MOST:
        raise ValueError("no size")
    if outcome.format not in FILE_TYPES:
        raise ValueError("no format")
    timings = outcome.report.get("timings_ms")
    if not isinstance(timings, dict) or not timings.keys() <= {*STAGES, "total"} or not _are_numbers(timings):
        raise ValueError("no timings")
    plan = outcome.report.get("plan", outcome.report)
    if not isinstance(plan, dict) or not _is_skipped(plan.get("skipped")):
        raise ValueError("no plan")
    return outcome


def _is_skipped(skipped: Any) -> bool:
    """Checks whether these can be shares of skipped pixels and triangles, or null."""
    if not isinstance(skipped, dict):
        return skipped is None
    if not skipped.keys() <= {*_COUNTED, "culled"} or len(_COUNTED & skipped.keys()) not in (0, 2):
        return False
    return _are_numbers(skipped)


def _are_numbers(values: dict[str, Any]) -> bool:
    return all(isinstance(value, int | float) and 0 <= value <= _MOST for value in values.values())


def _clean(text: str) -> str:
    return make_printable(text[:_MOST_TEXT])


def _parse_integer(digits: str) -> int:
    if len(digits) > _DIGITS:
        raise ValueError("an integer of too many digits")
    return int(digits)


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Ready(_Message):
    """The worker has loaded its models."""

    kind: Literal["ready"]
    missing: Annotated[list[Annotated[str, AfterValidator(_clean)]], Field(max_length=20)]
    """Restrictions that it lacks, one sentence each."""


class Started(_Message):
    """The worker has received its task."""

    kind: Literal["started"]


class Progress(_Message):
    """The data of a progress event."""

    kind: Literal["progress"]
    stage: Stage
    views_done: int = Field(ge=0, le=_MOST)
    views: int = Field(ge=0, le=_MOST)


class Failed(_Message):
    """The task raised an unexpected exception."""

    kind: Literal["failed"]
    traceback: str


class Done(_Message):
    """The task has ended."""

    kind: Literal["done"]
    outcome: Annotated[Result | Problem, AfterValidator(_check_outcome)]
    is_out_of_memory: bool


Message = Ready | Started | Progress | Failed | Done
_ADAPTER: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def parse_message(line: bytes) -> Message:
    """Checks and parses a line. Raises `ValueError` for anything that is not a message."""
    try:
        content = json.loads(line, parse_int=_parse_integer)
        # Python's JSON accepts Infinity, NaN and half a surrogate pair, but they can't be stored or sent.
        json.dumps(content, allow_nan=False, ensure_ascii=False).encode()
    except RecursionError as error:
        raise ValueError("too deep") from error
    return _ADAPTER.validate_python(content)


def quote(text: str, limit: int = 10_000) -> str:
    """Quotes a worker process's text for the log: at most `limit` characters, with each line marked as not our own."""
    return "\n".join(f"| {make_printable(line)}" for line in text[:limit].splitlines())


def make_printable(line: str) -> str:
    """Replaces the characters in `line` that would end it or control a terminal."""
    return "".join(character if character.isprintable() else "?" for character in line)
