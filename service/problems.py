"""Every error of the HTTP API in one shape: RFC 9457 problem details, `application/problem+json`."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse

from service.errors import FAULTS, meaning, one_line

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fastapi import FastAPI
    from starlette.requests import Request

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


def problem(
    path: str,
    status: int,
    detail: str,
    *,
    title: str | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """A problem at `path`; without a `title` it is HTTP's own, of the type about:blank."""
    content = {
        "type": "about:blank" if title is None else "urn:ciir:" + title.lower().replace(" ", "-"),
        "title": title or HTTPStatus(status).phrase,
        "status": status,
        "detail": one_line(detail),
        "instance": path,
    }
    return JSONResponse(content, status, headers, MEDIA_TYPE)


def of(fault: Exception, path: str) -> JSONResponse:
    """The problem that tells one of `service.errors.FAULTS`."""
    row = meaning(fault)
    detail = str(fault) if row.status != 500 else _DETAILS[500]
    headers = {"Retry-After": "1"} if row.status == 503 else None
    return problem(path, row.status, detail, title=row.title, headers=headers)


async def _fault(request: Request, error: Exception) -> JSONResponse:
    return of(error, request.url.path)


async def _http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 - registered for no other class
    detail = error.detail
    if detail == HTTPStatus(error.status_code).phrase:  # the framework's own words, which say nothing new
        detail = _DETAILS.get(error.status_code, detail)
    return problem(request.url.path, error.status_code, detail, headers=error.headers)


async def _gone(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001
    """Nobody is left to read it, and nothing went wrong here: no traceback in the log."""
    return problem(request.url.path, 400, "the client left before its request was whole; send it again")


async def _unexpected(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001 - the server logs it
    return problem(request.url.path, 500, _DETAILS[500])


def install(app: FastAPI) -> None:
    """Makes `app` answer every error as a problem. What nobody foresaw is raised on to the server's log as well."""
    for fault in FAULTS:
        app.add_exception_handler(fault, _fault)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ClientDisconnect, _gone)
    app.add_exception_handler(Exception, _unexpected)
