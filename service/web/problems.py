"""Every error of the HTTP API in one shape: RFC 9457 problem details, `application/problem+json`."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.routing import Match

from ciir.errors import Error, QueueFull
from ciir.service.errors import find_response, join_lines

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fastapi import FastAPI
    from starlette.requests import Request

    from ciir.service.jobs.job import Problem

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")
MEDIA_TYPE = "application/problem+json"
SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["type", "title", "status", "detail", "instance"],
    "properties": {
        "type": {"type": "string", "description": "urn:ciir:... for our own faults, about:blank for HTTP's"},
        "title": {"type": "string", "description": "the same for every fault of the type"},
        "status": {"type": "integer"},
        "detail": {"type": "string", "description": "one line: what was given, the limit, the remedy"},
        "instance": {"type": "string", "description": "the path that was asked for"},
    },
}
"""The shape, for OpenAPI."""
_DETAILS = {
    404: "nothing is here; GET /docs lists what is",
    405: "this path takes another method; the Allow header names it",
    500: "the server is at fault; its log says more",
}
RETRY_SECONDS = "1"
"""`Retry-After` of a 503."""


def describe_problem(path: str, status: int, detail: str, title: str | None = None) -> dict[str, Any]:
    """A problem at `path`, as `SCHEMA` has it; without a `title` it is HTTP's own, of the type about:blank."""
    return {
        "type": "about:blank" if title is None else "urn:ciir:" + title.lower().replace(" ", "-"),
        "title": title or HTTPStatus(status).phrase,
        "status": status,
        "detail": join_lines(detail),
        "instance": path,
    }


def describe_job_problem(found: Problem, path: str) -> dict[str, Any]:
    """The problem of a job that failed."""
    return describe_problem(path, found.status, found.detail, found.title)


def respond_problem(
    path: str,
    status: int,
    detail: str,
    *,
    title: str | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """`content` as an answer."""
    return JSONResponse(describe_problem(path, status, detail, title), status, headers, MEDIA_TYPE)


def respond_error(error: Error, path: str) -> JSONResponse:
    """The problem that reports `error`."""
    row = find_response(error)
    detail = str(error) if row.status != 500 else _DETAILS[500]
    headers = {"Retry-After": RETRY_SECONDS} if row.status == 503 else None
    if isinstance(error, QueueFull):
        headers = {"Retry-After": str(error.retry_after)}
    return respond_problem(path, row.status, detail, title=row.title, headers=headers)


def respond_job_problem(found: Problem, path: str) -> JSONResponse:
    """The same as an answer."""
    headers = {"Retry-After": RETRY_SECONDS} if found.status == 503 else None
    return JSONResponse(describe_job_problem(found, path), found.status, headers, MEDIA_TYPE)


def respond_server_error(path: str) -> JSONResponse:
    """The problem where nobody foresaw what went wrong: of that the log alone says more."""
    return respond_problem(path, 500, _DETAILS[500])


async def _error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, Error)  # noqa: S101 - registered for no other class
    return respond_error(error, request.url.path)


async def _http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 - registered for no other class
    detail = error.detail
    if detail == HTTPStatus(error.status_code).phrase:  # the framework's own words, which say nothing new
        detail = _DETAILS.get(error.status_code, detail)
    headers = _allow(request) if error.status_code == 405 else error.headers
    return respond_problem(request.url.path, error.status_code, detail, headers=headers)


def _allow(request: Request) -> dict[str, str]:
    """`Allow` with the methods of all routes at the path; the framework names those of one alone."""
    found = [
        method
        for method in METHODS
        if any(route.matches({**request.scope, "method": method})[0] is Match.FULL for route in request.app.routes)
    ]
    return {"Allow": ", ".join(found or ("GET", "HEAD"))}  # the latter: of a folder of files, where no route matches


async def _gone(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001
    """Nobody is left to read it, and nothing went wrong here: no traceback in the log."""
    return respond_problem(request.url.path, 400, "the client left before its request was whole; send it again")


def add_handlers(app: FastAPI) -> None:
    """Makes `app` answer every error as a problem, but for what nobody foresaw: see
    `service.web.middleware.tracking`."""
    app.add_exception_handler(Error, _error)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ClientDisconnect, _gone)
