"""A job's status and its result as HTTP responses."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import UTC, datetime
from typing import IO, TYPE_CHECKING, Any

from anyio import to_thread
from fastapi import Response
from fastapi.responses import JSONResponse, StreamingResponse

from ciir.errors import ResultExpired
from ciir.renderer.displays.quilt import QuiltLayout
from ciir.service.errors import CANCELLED, find_response
from ciir.service.jobs.job import FINAL
from ciir.service.pipeline.options import FILE_TYPES, KINDS
from ciir.service.web import problems
from ciir.service.web.ranges import describe_part, find_part

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from fastapi import Request

    from ciir.service.jobs.job import Job, Result
    from ciir.service.jobs.jobs import Jobs
    from ciir.service.pipeline.options import KindName

CACHE = "private, no-cache"
"""`Cache-Control` of results: a client may keep them, and asks with the ETag whether they have changed."""
LOST = "the result is no longer stored, or was damaged; post the input again"
NOTES_HEADER = "X-Notes"
"""The response header with the notes that the command line prints."""
MOST_NOTES = 3000
"""Most characters in that header: by default proxies accept about 4,000 in all headers."""
CHUNK = 2**18
"""Most bytes in a piece of a result. A smaller result is sent in one piece."""
RETRY_SECONDS = "1"
"""`Retry-After` while a job is not done."""
FAILED_RETRY_SECONDS = "10"
"""`Retry-After` of a POST whose job failed because of an error of the server, which takes longer to recover."""


def find_root(kind: KindName) -> str:
    """Returns the path of all jobs of that kind."""
    return f"/v1/{KINDS[kind].plural}"


def make_url(job: Job) -> str:
    """Returns the path of a job."""
    return f"{find_root(job.request.kind)}/{job.id}"


def name_id_header(kind: KindName) -> str:
    """Returns the name of the response header with a job's id."""
    return f"X-{kind.title()}-Id"


def describe_job(job: Job, *, has_result: bool = True) -> dict[str, Any]:
    """Returns a job's status as in `schemas`. `has_result`: whether the result of a finished job is stored."""
    status: dict[str, Any] = {
        "id": job.id,
        "state": job.state,
        "created": datetime.fromtimestamp(job.created, UTC).isoformat(timespec="milliseconds"),
        "attempts": job.attempts,
        "input": job.request.name,
        "options": job.request.options,
        "format": job.result.format if job.result is not None else job.request.format,
        "events": f"{make_url(job)}/events",
        "progress": _find_progress(job),
    }
    if job.result is not None:
        if has_result:
            status["result"] = {"url": f"{make_url(job)}/result", "format": job.result.format, "size": job.result.size}
        else:
            status["problem"] = problems.describe_problem(
                make_url(job), 410, LOST, find_response(ResultExpired()).title
            )
        status["report"] = job.result.report
    if job.problem is not None:
        status["problem"] = problems.describe_problem(make_url(job), **asdict(job.problem))
    return status


def _find_progress(job: Job) -> dict[str, Any] | None:
    """Returns the last progress of the current run; for a finished job, all views."""
    if job.result is not None and job.result.views:  # the last event may be older: there are at most 4 a second
        return {"stage": "encode", "views_done": job.result.views, "views": job.result.views}
    for event in reversed(job.events):
        if event.kind == "progress":
            return event.data
        if event.kind in ("queued", "running"):  # earlier progress belongs to an earlier run
            break
    return None


def respond_with_status(
    job: Job, code: int = 200, headers: Mapping[str, str] | None = None, *, has_result: bool = True
) -> JSONResponse:
    """Responds with the status made by `describe_job`, and with `Retry-After` if it will change."""
    again = {} if job.state in FINAL else {"Retry-After": RETRY_SECONDS}
    fixed = {"Cache-Control": "no-store", name_id_header(job.request.kind): job.id}
    return JSONResponse(describe_job(job, has_result=has_result), code, fixed | again | dict(headers or {}))


def respond_unfinished(job: Job, path: str, *, is_post: bool) -> JSONResponse:
    """Responds with the problem for a request for the result of a job that is not done.

    `is_post`: whether the same request runs a job again that failed because of an error of the server.
    """
    if job.problem is not None:
        response = problems.respond_problem(path, **asdict(job.problem))
        del response.headers["Retry-After"]
        if is_post and job.problem.status >= 500:
            response.headers["Retry-After"] = FAILED_RETRY_SECONDS
        return response
    if job.state == "cancelled":
        detail = "the job was cancelled; post the input again to run it"
        return problems.respond_problem(path, 409, detail, title=CANCELLED)
    headers = {"Retry-After": RETRY_SECONDS}
    detail = f"the job is {job.state}; ask again in a second, or follow {make_url(job)}/events"
    return problems.respond_problem(path, 409, detail, title="Not finished", headers=headers)


def make_tag(job: Job, result: Result) -> str:
    """Returns the ETag of a result: the job's id and the beginning of the file's SHA-256.

    It is strong: the same tag stands for the same bytes. The timings in a report differ between two runs of one job.
    """
    return f'"{job.id}-{result.sha256[:32]}"'


def has_tag(if_none_match: Iterable[str], tag: str) -> bool:
    """Checks whether `If-None-Match` headers list `tag`. The comparison is weak (RFC 9110); `*` lists none."""
    return any(given.strip().removeprefix("W/") == tag for header in if_none_match for given in header.split(","))


def _make_headers(job: Job, result: Result, timings: Mapping[str, float] | None) -> dict[str, str]:
    timings = result.report["timings_ms"] if timings is None else timings
    return {
        "ETag": make_tag(job, result),
        "Cache-Control": CACHE,
        "Content-Location": f"{make_url(job)}/result",
        name_id_header(job.request.kind): job.id,
        "Server-Timing": ", ".join(f"{stage};dur={ms:.3f}" for stage, ms in timings.items()),
        NOTES_HEADER: _write_notes(job, result.report["notes"]),
    }


def _write_notes(job: Job, notes: Sequence[str]) -> str:
    """Writes the notes as a JSON list in ASCII. If they are too long, the last item says where the others are."""
    kept: list[str] = []
    length = 0
    for note in notes:
        length += len(json.dumps(note))
        if length > MOST_NOTES:
            break
        kept.append(note)
    written = json.dumps(kept)
    while len(kept) < len(notes) or len(written) > MOST_NOTES:
        written = json.dumps([*kept, f"{len(notes) - len(kept)} more in the report of {make_url(job)}"])
        if len(written) <= MOST_NOTES:
            break
        kept.pop()
    return written


def respond_unchanged(job: Job, result: Result) -> Response:
    """Responds with 304: the client has the result."""
    kept = {"ETag": make_tag(job, result), "Content-Location": f"{make_url(job)}/result", "Cache-Control": CACHE}
    return Response(status_code=304, headers=kept | {name_id_header(job.request.kind): job.id})


async def respond_with_result(
    jobs: Jobs, job: Job, result: Result, timings: Mapping[str, float] | None = None
) -> Response:
    """Responds with the result of a finished job to the request that asked for the job.

    `timings`: milliseconds by stage, or None for those of the job. Raises `ResultExpired` or `QueueUnavailable`.
    """
    return await _respond(jobs, job, result, _make_headers(job, result, timings))


async def respond_to_read(jobs: Jobs, job: Job, result: Result, request: Request) -> Response:
    """Responds with the result of a finished job, or the part of it that a GET asks for, to its own request.

    Raises `ResultExpired` or `QueueUnavailable`.
    """
    fields = _make_headers(job, result, None) | {"Accept-Ranges": "bytes"}
    is_head = request.method == "HEAD"
    part = None if is_head else find_part(request.headers, fields["ETag"], result.size)
    if part is None:
        return await _respond(jobs, job, result, fields, is_head=is_head)
    where = {"Content-Range": describe_part(part, result.size)}
    if not part:
        detail = f"Range: {request.headers['range'][:80]!r} asks for no byte of the {result.size:,}; leave it out"
        return problems.respond_problem(request.url.path, 416, detail, title="No such part", headers=where)
    return await _respond(jobs, job, result, fields | where, part=part)


async def _respond(
    jobs: Jobs,
    job: Job,
    result: Result,
    fields: dict[str, str],
    *,
    is_head: bool = False,
    part: range | None = None,
) -> Response:
    wanted = part or range(result.size)
    status = 200 if part is None else 206
    file, start = await to_thread.run_sync(_open_result, jobs, job.id, wanted)
    fields["Content-Disposition"] = f'attachment; filename="{name_file(job.id, result)}"'
    media_type = FILE_TYPES[result.format].media_type
    if len(start) == len(wanted):
        file.close()
        return Response(start, status, headers=fields, media_type=media_type)
    fields["Content-Length"] = str(len(wanted))
    if is_head:
        file.close()
        return Response(headers=fields, media_type=media_type)
    chunks = _read_chunks(file, start, len(wanted))
    return StreamingResponse(chunks, status, headers=fields, media_type=media_type)


def name_file(id_: str, result: Result) -> str:
    """Returns the file name for a result. A quilt's name contains its layout, because displays read it there."""
    layout = result.report.get("display", {}).get("layout")
    return f"{id_}{QuiltLayout(**layout).suffix if layout else ''}{FILE_TYPES[result.format].suffix}"


def _open_result(jobs: Jobs, id_: str, wanted: range) -> tuple[IO[bytes], bytes]:
    file = jobs.open_result(id_)
    file.seek(wanted.start)
    return file, file.read(min(CHUNK, len(wanted)))


def _read_chunks(file: IO[bytes], start: bytes, length: int) -> Iterator[bytes]:
    """Yields `length` bytes of the file, of which `start` has been read."""
    with file:
        chunk = start
        while chunk:
            yield chunk
            length -= len(chunk)
            chunk = file.read(min(CHUNK, length))
