"""The routes under /v1/reconstructions: every reconstruction is a job, whether the client waits for it or not."""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import AsyncIterator  # noqa: TC003 - FastAPI looks at what a stream of events yields
from typing import TYPE_CHECKING, Annotated

import anyio
from anyio import to_thread
from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from opentelemetry import trace
from starlette.exceptions import HTTPException

from ciir.errors import QueueFull, QueueUnavailable, ResultExpired
from ciir.service.jobs import job as job_module
from ciir.service.jobs.job import FINAL, Job
from ciir.service.web import multipart, openapi
from ciir.service.web.prefer import Preference
from ciir.service.web.routes import results, upload

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from ciir.service.web.routes.state import ServiceState
    from ciir.service.web.routes.upload import Upload

_ID = Path(alias="id", description="a job's id", examples=["0123456789abcdef0123456789abcdef"])
RETRY_MILLISECONDS = 1000
"""After which a client whose stream of events broke off comes again."""
_log = logging.getLogger("ciir.jobs")


class NoNews(Exception):  # noqa: N818 - no fault
    """A job is at its end and the client has seen all of it: 204, by which a browser ends its stream of events."""


def make_router(state: ServiceState) -> APIRouter:
    """All routes."""
    routes = APIRouter(prefix=results.ROOT)
    _add_post(routes, state)
    _add_job(routes, state)
    _add_events(routes, state)
    return routes


def _add_post(routes: APIRouter, state: ServiceState) -> None:
    @routes.post(
        "",
        summary="Views out of a mesh, an EIA picture or a zip of views",
        response_class=Response,
        responses=openapi.describe_result()
        | openapi.describe_status(202, "it takes longer; the job goes on", Location="the job", Retry_After="seconds")
        | openapi.describe_errors(400, 401, 408, 409, 413, 415, 422, 429, 503),
        openapi_extra={
            "parameters": [openapi.PREFER, openapi.IF_NONE_MATCH],
            "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": upload.SCHEMA}}},
        },
    )
    async def create_reconstruction(request: Request) -> Response:
        begun = time.perf_counter()
        state.engine.check_accepting()
        upload.check_content_type(request.headers.get("content-type"))
        form = await multipart.read_form(request)
        try:
            given = upload.parse_form(form.multi_items())
            tags = request.headers.getlist("if-none-match")
            if tags and (held := await to_thread.run_sync(_held, state, given, tags)) is not None:
                return results.respond_unchanged(held)
            job = await _submitted(state, given)
        finally:
            await form.close()
        preference = Preference.parse(request.headers.getlist("prefer"))
        was_done = job.state == "done"
        seconds = preference.wait_seconds(state.settings.sync_seconds)
        if not preference.is_async or preference.wait:
            job = await _waited(state, job, seconds)
        else:
            was_done = False
        applied = preference.format_applied(state.settings.sync_seconds)
        extra = {"Preference-Applied": applied} if applied else {}
        if job.state in ("failed", "cancelled"):
            answer: Response = results.respond_unfinished(job, request.url.path)
        elif job.result is None or (preference.is_async and not preference.wait):
            answer = results.respond_with_status(job, 202, {"Location": results.make_url(job)})
        else:
            milliseconds = 1000 * (time.perf_counter() - begun)
            timings = {"stored": milliseconds, "total": milliseconds} if was_done else None
            try:
                answer = await results.respond_with_result(state.engine.jobs, job, job.result, timings)
            except ResultExpired as error:  # between two words of ours
                raise QueueUnavailable("the result expired just now; post it again") from error
        answer.headers.update(extra)
        return answer


def _held(state: ServiceState, given: Upload, tags: list[str]) -> str | None:
    """The tag of the result, as the client has it, if `tags` name it: then nothing need be made, or kept."""
    return results.find_matching_tag(tags, state.engine.jobs.compute_id(_request(given), given.file))


def _request(given: Upload) -> job_module.Request:
    return job_module.Request(given.name, given.texts, given.format)


async def _submitted(state: ServiceState, given: Upload) -> Job:
    """The job of what was sent. Raises `QueueFull` or `QueueUnavailable`."""
    try:
        job = await to_thread.run_sync(lambda: state.engine.jobs.submit(_request(given), given.file, size=given.size))
    except (QueueFull, QueueUnavailable):
        state.metrics.submitted.labels("refused").inc()
        raise
    state.metrics.submitted.labels("known" if job.state in FINAL else "accepted").inc()
    trace.get_current_span().set_attribute("ciir.job", job.id)
    _log.info("job %s: %s, %d bytes, %s", job.id, given.name, given.size, job.state)
    return job


async def _waited(state: ServiceState, job: Job, seconds: float) -> Job:
    """`job` at its end, or as it stands after that time."""
    with anyio.move_on_after(seconds):
        while job.state not in FINAL:
            later = await state.wait_for_change(job)
            if later is None:
                break
            job = later
    return job


def _finder(state: ServiceState) -> Callable[[str], Awaitable[Job]]:
    """A dependency: the job that the path names. Raises `HTTPException` 404."""

    async def find(id_: Annotated[str, _ID]) -> Job:
        found = None
        if re.fullmatch(r"[0-9a-f]{32}", id_):
            found = await to_thread.run_sync(state.engine.jobs.get, id_)
        if found is None:
            raise HTTPException(404, f"there is no job {id_[:40]!r}, or no more; post its file again")
        return found

    return find


def _add_job(routes: APIRouter, state: ServiceState) -> None:
    found = Depends(_finder(state))

    @routes.head("/{id}", include_in_schema=False)
    @routes.get(
        "/{id}",
        summary="A job as it stands",
        response_class=Response,
        responses=openapi.describe_status(200, "its status") | openapi.describe_errors(401, 404, 503),
    )
    async def read_reconstruction(job: Job = found) -> Response:
        return results.respond_with_status(job)

    @routes.delete(
        "/{id}",
        summary="A job is cancelled, unless it has ended",
        description="For everybody who asked for the same: a job is known by its content.",
        response_class=Response,
        responses=openapi.describe_status(200, "its status: cancelled, or as it ended")
        | openapi.describe_errors(401, 404, 503),
    )
    async def cancel_reconstruction(job: Job = found) -> Response:
        cancelled = await to_thread.run_sync(state.engine.jobs.cancel, job.id)
        return results.respond_with_status(cancelled or job)

    @routes.head("/{id}/result", include_in_schema=False)
    @routes.get(
        "/{id}/result",
        summary="The views",
        response_class=Response,
        responses=openapi.describe_result() | openapi.describe_errors(401, 404, 409, 410, 413, 415, 422, 503),
        openapi_extra={"parameters": [openapi.IF_NONE_MATCH]},
    )
    async def read_result(request: Request, job: Job = found) -> Response:
        if job.result is None:
            return results.respond_unfinished(job, request.url.path)
        tag = results.find_matching_tag(request.headers.getlist("if-none-match"), job.id)
        if tag is not None:
            return results.respond_unchanged(tag)
        return await results.respond_with_result(state.engine.jobs, job, job.result, is_head=request.method == "HEAD")


def _add_events(routes: APIRouter, state: ServiceState) -> None:
    found = Depends(_finder(state))

    async def news(request: Request, job: Job = found) -> tuple[Job, int]:
        """The job, and the number of the first event to send."""
        last = request.headers.get("last-event-id", "").strip()
        if last and re.fullmatch(r"\d{1,9}", last) is None:
            raise HTTPException(400, f"Last-Event-ID: {last[:40]!r} is no event's number; leave it out to have all")
        first = int(last) + 1 if last else 0
        if job.state in FINAL and first >= len(job.events):
            raise NoNews
        return job, first

    begin_at = Depends(news)

    @routes.get(
        "/{id}/events",
        summary="What happens to a job, as server-sent events",
        description="Numbered from 0, from the first or from behind `Last-Event-ID`, until the job has ended.",
        response_class=EventSourceResponse,
        responses=openapi.describe_response(204, "the job has ended and the client has all events")
        | openapi.describe_errors(400, 401, 404, 503),
        openapi_extra={"parameters": [openapi.LAST_EVENT_ID]},
    )
    async def read_events(begin: tuple[Job, int] = begin_at) -> AsyncIterator[ServerSentEvent]:
        job, sent = begin
        yield ServerSentEvent(comment=f"job {job.id}", retry=RETRY_MILLISECONDS)
        while True:
            sent = sent if sent <= len(job.events) else 0  # it was asked for again, and is another run
            for number, event in enumerate(job.events[sent:], sent):
                yield ServerSentEvent(event=event.kind, id=str(number), raw_data=json.dumps(event.data))
            sent = len(job.events)
            if job.state in FINAL:
                return
            try:
                later = await state.wait_for_change(job)
            except (LookupError, QueueUnavailable) as error:  # the head is out: the client comes again and hears of it
                _log.warning("events of job %s break off: %s", job.id, error)
                return
            if later is None:
                return
            job = later
