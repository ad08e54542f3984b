"""The routes of files that are sent once and used by several requests, each as the field `file_id` of a job's form."""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from ciir.errors import NoRoom, ResultExpired, TooLarge
from ciir.renderer.readers.names import clean_text
from ciir.service.jobs.job import FINAL, KEPT_FILE, Job
from ciir.service.pipeline.options import KINDS
from ciir.service.web import multipart
from ciir.service.web.middleware.api_keys import hash_client
from ciir.service.web.problems import respond_error
from ciir.service.web.routes import openapi, results, schemas, upload
from ciir.service.web.routes.state import State  # noqa: TC001 - FastAPI reads the annotations of routes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.service.web.routes.state import ServiceState
    from ciir.service.web.routes.upload import Upload

ROOT = "/v1/files"
_ID = re.compile(r"[0-9a-f]{32}")
_NO_ROOM_SECONDS = "60"
"""`Retry-After` if there is no room for a file, which may be large, so that it isn't sent again and again at once."""
_ENDS = {"failed": "failed", "cancelled": "was cancelled"}
_log = logging.getLogger("ciir.jobs")


def open_kept(state: ServiceState, given: Upload) -> Upload:
    """Returns the form with the file that its `file_id` names: a kept file, or the result of a finished job.

    Raises `ResultExpired` if there is none, `TooLarge`, and `HTTPException` 409 if the job has not ended.
    """
    jobs, limit = state.engine.jobs, state.settings.max_body_bytes
    id_ = given.file_id if _ID.fullmatch(given.file_id) else ""  # no file has this id
    job = jobs.get(id_)
    if job is not None and job.state not in FINAL:
        detail = f"{upload.FILE_ID}: the job {id_} is {job.state}; send this again once it is done"
        raise HTTPException(409, detail, {"Retry-After": results.RETRY_SECONDS})
    if job is not None and job.state in ("failed", "cancelled"):
        why = f" ({job.problem.detail})" if job.problem is not None else ""
        raise ResultExpired(f"{upload.FILE_ID}: the job {id_} has no result: it {_ENDS[job.state]}{why}")
    if job is not None and job.result is not None and job.result.size > limit:
        size = f"{job.result.size:,} bytes, over the limit of {limit:,}"
        raise TooLarge(f"{upload.FILE_ID}: a result of {size}; make a smaller one")
    try:
        job, file = jobs.open_source(id_)
    except ResultExpired as error:
        shown = clean_text(given.file_id)[:40]
        cause = f"no file or result {shown!r} is kept, or it has expired"
        raise ResultExpired(f"{upload.FILE_ID}: {cause}; send the file again") from error
    assert job.result is not None  # noqa: S101 - it was opened
    name = job.request.name if job.request.kind == KEPT_FILE else results.name_file(job.id, job.result)
    name = upload.make_name(name, takes_light_fields=KINDS[given.request.kind].takes_light_fields)
    return replace(
        given,
        request=replace(given.request, name=name),
        file=file,
        size=job.result.size,
        content=job.result.sha256,
    )


async def find_file(
    state: State,
    id_: Annotated[str, Path(alias="id", description="a file's id", examples=["0123456789abcdef0123456789abcdef"])],
) -> Job:
    """Finds the kept file in the path. A dependency. Raises `HTTPException` 404."""

    def find() -> Job | None:
        job = state.engine.jobs.get(id_) if _ID.fullmatch(id_) else None
        is_kept = job is not None and job.request.kind == KEPT_FILE and state.engine.jobs.stores_result(job)
        return job if is_kept else None

    found = await to_thread.run_sync(find)
    if found is None:
        raise HTTPException(404, f"there is no file {id_[:40]!r}, or it was removed or has expired; send it again")
    return found


FoundFile = Annotated[Job, Depends(find_file)]


def _respond(job: Job, code: int = 200, headers: Mapping[str, str] | None = None) -> JSONResponse:
    size = 0 if job.result is None else job.result.size
    described: dict[str, Any] = {"id": job.id, "name": job.request.name, "bytes": size}
    return JSONResponse(described, code, {"Cache-Control": "no-store"} | dict(headers or {}))


async def keep_file(request: Request, state: State) -> Response:
    """Keeps the file. The same file under the same name has the same id, and is kept for longer."""
    state.engine.check_accepting()
    upload.check_head(request.query_params, request.headers)
    try:
        form = await multipart.read_form(request)
        try:
            name, file = upload.parse_file(form.multi_items())
            job, is_new = await to_thread.run_sync(state.engine.jobs.keep_file, name, file, hash_client(request))
        finally:
            await form.close()
    except NoRoom as error:
        return respond_error(error, request.url.path, _NO_ROOM_SECONDS)
    _log.info("file %s: %s, %s", job.id, name, "kept" if is_new else "known")
    return _respond(job, 201 if is_new else 200, {"Location": f"{ROOT}/{job.id}"})


async def read_file(job: FoundFile) -> Response:
    """Says that the file is kept. This does not count as a use of it."""
    return _respond(job)


async def remove_file(request: Request, job: FoundFile, state: State) -> Response:
    """Removes the file, unless another client has sent it too."""
    await to_thread.run_sync(state.engine.jobs.cancel, job.id, hash_client(request))
    return _respond(job)


def make_router() -> APIRouter:
    """Makes the routes."""
    router = APIRouter(prefix=ROOT, tags=["files"], default_response_class=Response)
    kept, location = schemas.refer("KeptFile"), {"Location": "path of the file"}
    errors = openapi.describe_errors(401, 404, 503)
    router.post(
        "",
        operation_id="createFile",
        summary="Keep a file, to use it in several requests as `file_id`",
        responses=openapi.describe_json(201, "the file is kept", kept, **location)
        | openapi.describe_json(200, "the same file was kept already, and is kept for longer now", kept, **location)
        | openapi.describe_errors(400, 401, 408, 413, 415, 422, 503),
        openapi_extra={"requestBody": openapi.describe_form("File")},
    )(keep_file)
    router.head("/{id}", include_in_schema=False)(read_file)
    router.get(
        "/{id}",
        operation_id="getFile",
        summary="Whether a file is still kept",
        responses=openapi.describe_json(200, "the file is kept", kept) | errors,
    )(read_file)
    router.delete(
        "/{id}",
        operation_id="deleteFile",
        summary="Remove a kept file, unless another client has sent it too",
        responses=openapi.describe_json(200, "the file as it was", kept) | errors,
    )(remove_file)
    return router
