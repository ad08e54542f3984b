"""A job as HTTP tells it: its status, and its result with the headers that go with it."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import IO, TYPE_CHECKING, Any

from anyio import to_thread
from fastapi import Response
from fastapi.responses import JSONResponse, StreamingResponse

from ciir.renderer.writers.formats import FORMATS
from ciir.service.web import problems

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from ciir.service.jobs.job import Job, Result
    from ciir.service.jobs.jobs import Jobs

ROOT = "/v1/reconstructions"
CACHE = "private, no-cache"
"""Of results: whoever asked may keep them, and asks with the tag whether they still are the same."""
CHUNK = 2**18
"""Bytes that are read of a result at once; one that is no larger is sent in one piece."""
RETRY_SECONDS = "1"
"""`Retry-After` of a job that isn't done."""
STATUS_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["id", "state", "created", "attempts", "input", "options", "format", "events", "progress"],
    "properties": {
        "id": {"type": "string", "pattern": "^[0-9a-f]{32}$", "description": "of what was asked for, by its content"},
        "state": {"type": "string", "enum": ["queued", "running", "done", "failed", "cancelled"]},
        "created": {"type": "string", "format": "date-time"},
        "attempts": {"type": "integer", "minimum": 0, "description": "how often its work was begun"},
        "input": {"type": "string", "description": "`upload` and the suffix of the file's name"},
        "options": {"type": "object", "additionalProperties": {"type": "string"}, "description": "as they were given"},
        "format": {"type": "string", "nullable": True, "description": "as asked for, then as it is"},
        "events": {"type": "string", "description": "where it tells of itself, as server-sent events"},
        "progress": {
            "type": "object",
            "nullable": True,
            "description": "stage, views_done, views: of the newest run's last word",
        },
        "result": {"type": "object", "description": "url, format, size in bytes; where it is done"},
        "report": {
            "type": "object",
            "description": "what was read and made, and how, but for its list of views; where it is done",
        },
        "problem": problems.SCHEMA | {"description": "why it failed; where it did"},
    },
}
"""A job's status, for OpenAPI."""


def make_url(job: Job) -> str:
    """Where a job is."""
    return f"{ROOT}/{job.id}"


def describe_job(job: Job) -> dict[str, Any]:
    """What `SCHEMA` describes."""
    told: dict[str, Any] = {
        "id": job.id,
        "state": job.state,
        "created": datetime.fromtimestamp(job.created, UTC).isoformat(timespec="milliseconds"),
        "attempts": job.attempts,
        "input": job.request.name,
        "options": job.request.options,
        "format": job.result.format if job.result is not None else job.request.format,
        "events": f"{make_url(job)}/events",
        "progress": _progress(job),
    }
    if job.result is not None:
        told["result"] = {"url": f"{make_url(job)}/result", "format": job.result.format, "size": job.result.size}
        told["report"] = job.result.report
    if job.problem is not None:
        told["problem"] = problems.describe_job_problem(job.problem, make_url(job))
    return told


def _progress(job: Job) -> dict[str, Any] | None:
    """The last word of the newest run. Of a job that is done: all views, even where no event said so."""
    if job.result is not None and "views" in job.result.report:
        count = len(job.result.report["views"])
        return {"stage": "encode", "views_done": count, "views": count}
    for event in reversed(job.events):
        if event.kind == "progress":
            return event.data
        if event.kind in ("queued", "running"):  # what an earlier run had done is done anew
            break
    return None


def respond_with_status(job: Job, code: int = 200, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """The status as an answer; one that will change says when to ask again."""
    again = {"Retry-After": RETRY_SECONDS} if job.state in ("queued", "running") else {}
    fixed = {"Cache-Control": "no-store", "X-Reconstruction-Id": job.id}
    return JSONResponse(describe_job(job), code, fixed | again | dict(headers or {}))


def respond_unfinished(job: Job, path: str) -> JSONResponse:
    """The problem of a result that was asked for and isn't there, for each state but `done`."""
    if job.problem is not None:
        return problems.respond_job_problem(job.problem, path)
    if job.state == "cancelled":
        return problems.respond_problem(path, 409, "it was cancelled; post it again to have it made", title="Cancelled")
    headers = {"Retry-After": RETRY_SECONDS}
    detail = f"it is {job.state}; ask again in a second, or follow {make_url(job)}/events"
    return problems.respond_problem(path, 409, detail, title="Not finished", headers=headers)


def find_matching_tag(if_none_match: Iterable[str], id_: str) -> str | None:
    """The tag of the `If-None-Match` headers that names the result of the job `id_`; None where none does.

    By weak comparison (RFC 9110); `*`, which names any, is none of ours.
    """
    tags = [tag.strip() for header in if_none_match for tag in header.split(",")]
    return next((tag for tag in tags if tag.removeprefix("W/") == f'"{id_}"'), None)


def make_headers(job: Job, result: Result, timings: Mapping[str, float]) -> dict[str, str]:
    """Of an answer that holds the result; `timings`: milliseconds by stage."""
    # A report holds timings, so that two results of one id differ in them: a weak tag.
    tag = f'W/"{job.id}"' if FORMATS[result.format].holds_report else f'"{job.id}"'
    return {
        "ETag": tag,
        "Cache-Control": CACHE,
        "Content-Location": f"{make_url(job)}/result",
        "X-Reconstruction-Id": job.id,
        "Server-Timing": ", ".join(f"{stage};dur={ms:.3f}" for stage, ms in timings.items()),
    }


def respond_unchanged(tag: str) -> Response:
    """304: the client has the result that `tag` names."""
    id_ = tag.removeprefix("W/").strip('"')
    kept = {"ETag": tag, "Content-Location": f"{ROOT}/{id_}/result", "X-Reconstruction-Id": id_}
    return Response(status_code=304, headers=kept | {"Cache-Control": CACHE})


async def respond_with_result(
    jobs: Jobs, job: Job, result: Result, timings: Mapping[str, float] | None = None, *, is_head: bool = False
) -> Response:
    """The result of a job that is done; `timings` are its own where None is given; `is_head`: nobody reads its bytes.

    Raises `ResultExpired` or `QueueUnavailable`.
    """
    file, start = await to_thread.run_sync(_opened, jobs, job.id)
    fields = make_headers(job, result, result.report["timings_ms"] if timings is None else timings)
    fields["Content-Disposition"] = f'attachment; filename="{job.id}.{result.format}"'
    media_type = FORMATS[result.format].media_type
    if len(start) == result.size:
        file.close()
        return Response(start, headers=fields, media_type=media_type)
    fields["Content-Length"] = str(result.size)
    if is_head:
        file.close()
        return Response(headers=fields, media_type=media_type)
    return StreamingResponse(_chunks(file, start), headers=fields, media_type=media_type)


def _opened(jobs: Jobs, id_: str) -> tuple[IO[bytes], bytes]:
    file = jobs.open_result(id_)
    try:
        return file, file.read(CHUNK)
    except BaseException:
        file.close()
        raise


def _chunks(file: IO[bytes], start: bytes) -> Iterator[bytes]:
    with file:
        chunk = start
        while chunk:
            yield chunk
            chunk = file.read(CHUNK)
