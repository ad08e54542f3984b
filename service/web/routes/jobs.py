"""The routes of jobs, the same for each kind of job. Every request is a job, even if the client waits for it."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import AsyncIterator  # noqa: TC003 - FastAPI looks at what a stream of events yields
from typing import TYPE_CHECKING, Annotated

import anyio
from anyio import to_thread
from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.responses import StreamingResponse
from opentelemetry import trace
from starlette.exceptions import HTTPException

from ciir.errors import QueueFull, QueueUnavailable, ResultExpired
from ciir.service.jobs.job import FINAL, Job
from ciir.service.pipeline.options import KINDS, Kind
from ciir.service.web import multipart
from ciir.service.web.middleware.api_keys import find_client, hash_client
from ciir.service.web.prefer import Preference
from ciir.service.web.routes import events, files, openapi, results, schemas, upload
from ciir.service.web.routes.state import State  # noqa: TC001 - FastAPI reads the annotations of routes

if TYPE_CHECKING:
    from ciir.service.jobs.job import Result
    from ciir.service.web.routes.upload import Upload

_log = logging.getLogger("ciir.jobs")


class NoMoreEvents(Exception):  # noqa: N818 - not an error
    """The job has ended and the client has all its events: 204, which stops a browser from reconnecting."""


def find_kind(request: Request) -> Kind:
    """Finds the kind of job that the route is for. A dependency."""
    return next(kind for kind in KINDS.values() if request.scope["route"].path.startswith(results.find_root(kind.name)))


FoundKind = Annotated[Kind, Depends(find_kind)]


async def find_job(
    state: State,
    kind: FoundKind,
    id_: Annotated[str, Path(alias="id", description="a job's id", examples=["0123456789abcdef0123456789abcdef"])],
) -> Job:
    """Finds the job in the path. A dependency. Raises `HTTPException` 404."""
    found = None
    if re.fullmatch(r"[0-9a-f]{32}", id_):
        found = await to_thread.run_sync(state.engine.jobs.get, id_)
    if found is None or found.request.kind != kind.name:
        gone = "or it was removed or has expired; post its file again"
        raise HTTPException(404, f"there is no {kind.name} {id_[:40]!r}, {gone}")
    return found


FoundJob = Annotated[Job, Depends(find_job)]


async def create_job(request: Request, kind: FoundKind, state: State) -> Response:
    """Waits for the result up to CIIR_SYNC_SECONDS, or as long as `Prefer` asks for. After that the answer is 202."""
    start = time.perf_counter()
    state.engine.check_accepting()
    upload.check_head(request.query_params, request.headers)
    form = await multipart.read_form(request)
    try:
        given = upload.parse_form(form.multi_items(), kind)
        if given.file_id:
            given = await to_thread.run_sync(files.open_kept, state, given)
        with given.file:
            job = await _submit(state, given, hash_client(request))
    finally:
        await form.close()
    preference = Preference.parse(request.headers.getlist("prefer"))
    waits = not preference.is_async or bool(preference.wait)
    was_done = job.state == "done"
    if waits:
        job = await _wait_for_end(state, job, preference.wait_seconds(state.settings.sync_seconds))
    if job.state in ("failed", "cancelled"):
        response: Response = results.respond_unfinished(job, request.url.path, is_post=True)
    elif job.result is not None and _is_known(request, job, job.result):
        response = results.respond_unchanged(job, job.result)
    elif job.result is None or not waits:
        response = results.respond_with_status(job, 202, {"Location": results.make_url(job)})
    else:
        milliseconds = 1000 * (time.perf_counter() - start)
        timings = {"stored": milliseconds, "total": milliseconds} if was_done else None
        try:
            response = await results.respond_with_result(state.engine.jobs, job, job.result, timings)
        except ResultExpired as error:  # it expired after the job was looked up
            raise QueueUnavailable("the result expired just now; post the input again") from error
    if applied := preference.format_applied(state.settings.sync_seconds):
        response.headers["Preference-Applied"] = applied
    return response


async def _submit(state: State, given: Upload, client: str) -> Job:
    """Submits the form as a job of that client. Raises `QueueFull` or `QueueUnavailable`."""
    try:
        job, is_new = await to_thread.run_sync(
            state.engine.jobs.submit, given.request, given.file, client, given.content
        )
    except (QueueFull, QueueUnavailable) as error:
        state.engine.metrics.submitted.labels("refused").inc()
        _log.info("refused %s of %s, %d bytes: %s", given.request.kind, given.request.name, given.size, error)
        raise
    state.engine.metrics.submitted.labels("accepted" if is_new else "known").inc()
    trace.get_current_span().set_attribute("ciir.job", job.id)
    _log.info("job %s: %s of %s, %d bytes, %s", job.id, job.request.kind, given.request.name, given.size, job.state)
    return job


async def _wait_for_end(state: State, job: Job, seconds: float) -> Job:
    """Waits for the end of `job`, but at most that long."""
    with anyio.move_on_after(seconds):
        while job.state not in FINAL:
            later = await state.engine.jobs.watcher.wait_for_change(job.id, len(job.events))
            if later is None:
                break
            job = later
    return job


def _is_known(request: Request, job: Job, result: Result) -> bool:
    """Checks whether `If-None-Match` says that the client has this result."""
    return results.has_tag(request.headers.getlist("if-none-match"), results.make_tag(job, result))


async def read_job(job: FoundJob, state: State) -> Response:
    """Returns the status; at the end of the job with its report or problem."""
    has_result = job.result is None or await to_thread.run_sync(state.engine.jobs.stores_result, job)
    return results.respond_with_status(job, has_result=has_result)


async def cancel_job(request: Request, job: FoundJob, state: State) -> Response:
    """Cancels the job, or removes one that has ended, unless other clients have asked for it too."""
    cancelled = await to_thread.run_sync(state.engine.jobs.cancel, job.id, hash_client(request))
    return results.respond_with_status(cancelled or job)


async def read_result(request: Request, job: FoundJob, state: State) -> Response:
    """Returns the result file, or a part of it; if the job failed, its problem."""
    if job.result is None:
        return results.respond_unfinished(job, request.url.path, is_post=False)
    is_known = _is_known(request, job, job.result) or request.headers.get("if-none-match", "").strip() == "*"
    if is_known and await to_thread.run_sync(state.engine.jobs.stores_result, job):
        return results.respond_unchanged(job, job.result)
    return await results.respond_to_read(state.engine.jobs, job, job.result, request)


async def find_start(request: Request, job: FoundJob) -> tuple[Job, int]:
    """Finds the job and the number of the first event to send. A dependency."""
    last = request.headers.get("last-event-id", "").strip()
    if last and re.fullmatch(r"\d{1,9}", last) is None:
        raise HTTPException(
            400, f"Last-Event-ID: {last[:40]!r} is not the number of an event; leave it out for all events"
        )
    first = int(last) + 1 if last else 0
    if job.state in FINAL and first >= len(job.events):
        raise NoMoreEvents
    return job, first


Start = Annotated[tuple[Job, int], Depends(find_start)]


async def count_stream(request: Request, state: State) -> AsyncIterator[None]:
    """Counts the stream until it ends. A dependency. Raises `HTTPException` 429 if there are too many."""
    with state.streams.count(find_client(request)):
        yield


async def read_events(start: Start, state: State, _counted: Annotated[None, Depends(count_stream)]) -> Response:
    """Sends the events."""
    stream = events.stream_events(state.engine.jobs.watcher, *start)
    return StreamingResponse(stream, headers=events.HEADERS, media_type="text/event-stream")


def make_router(kind: Kind) -> APIRouter:
    """Makes the routes for one kind of job."""
    title = kind.name.title()
    router = APIRouter(prefix=results.find_root(kind.name), tags=[kind.plural], default_response_class=Response)
    status = openapi.describe_errors(401, 404, 503)
    router.post(
        "",
        operation_id=f"create{title}",
        summary=kind.summary,
        responses=openapi.describe_result(kind)
        | openapi.describe_status(
            kind, 202, "the job is not done yet", Location="path of the job", Retry_After="seconds"
        )
        | openapi.describe_errors(400, 401, 408, 409, 410, 413, 415, 422, 429, 503),
        openapi_extra={
            "parameters": [openapi.PREFER, openapi.IF_NONE_MATCH],
            "requestBody": openapi.describe_form(kind.name),
        },
    )(create_job)
    router.head("/{id}", include_in_schema=False)(read_job)
    router.get(
        "/{id}",
        operation_id=f"get{title}",
        summary="Status of a job",
        responses=openapi.describe_status(kind, 200, "the status") | status,
    )(read_job)
    router.delete(
        "/{id}",
        operation_id=f"delete{title}",
        summary="Cancel a job, or remove one that has ended with its result",
        description="Identical requests share one job. The job goes on, and its result is kept, as long as another "
        "client (API key, or address) that asked for it has not cancelled it.",
        responses=openapi.describe_status(
            kind,
            200,
            "the status: cancelled, the status at its end, or queued or running if the job goes on for other clients",
        )
        | status,
    )(cancel_job)
    router.head("/{id}/result", include_in_schema=False)(read_result)
    router.get(
        "/{id}/result",
        operation_id=f"get{title}Result",
        summary="Result of a job",
        responses=openapi.describe_result(kind)
        | openapi.describe_part(kind)
        | openapi.describe_errors(401, 404, 409, 410, 413, 415, 416, 422, 503),
        openapi_extra={"parameters": [openapi.IF_NONE_MATCH, openapi.RANGE, openapi.IF_RANGE]},
    )(read_result)
    router.get(
        "/{id}/events",
        operation_id=f"get{title}Events",
        summary="Events of a job, as server-sent events",
        description="Sends all events, or those after `Last-Event-ID`, until the job ends. They are numbered from 0.",
        responses=openapi.describe_response(204, "the job has ended, and the client has all events")
        | openapi.describe_json(200, "the events", schemas.refer("Event"), "text/event-stream")
        | openapi.describe_errors(400, 401, 404, 429, 503),
        openapi_extra={"parameters": [openapi.LAST_EVENT_ID]},
    )(read_events)
    return router
