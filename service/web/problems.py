"""Errors of the HTTP API: RFC 9457 problem details, `application/problem+json`."""

from __future__ import annotations

import logging
import re
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.routing import Match

from ciir.errors import Error, QueueFull
from ciir.service.errors import find_response, join_lines
from ciir.service.pipeline.options import KINDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fastapi import FastAPI
    from starlette.requests import Request

    from ciir.service.pipeline.options import KindName

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")
MEDIA_TYPE = "application/problem+json"
SERVER_ERROR = "the server had an error; its log has the details"
_DETAILS = {
    404: "there is nothing at this path; GET /docs lists the routes",
    405: "this path does not support the method; the Allow header lists the supported ones",
}
_KINDS: dict[str, KindName] = {
    "reconstruct": "reconstruction",
    "convert": "reconstruction",
    "upscale": "upscale",
    "elemental": "elemental",
    "refocus": "plane",
    "depth": "disparity",
}
_REQUESTS = {command: f"POST /v1/{KINDS[kind].plural}" for command, kind in _KINDS.items()} | {
    "models": "GET /v1/models"
}
"""Commands of the command line that messages name -> requests that do the same."""
MOST_PATH = 200
"""Most characters of a path in a problem and in the log."""
RETRY_SECONDS = "1"
"""`Retry-After` of a 503."""
_log = logging.getLogger("ciir")


def format_message(text: str) -> str:
    """Formats a message as one line, with requests in place of commands: `POST /v1/upscales` for `ciir upscale`."""
    return re.sub(rf"`ciir ({'|'.join(_REQUESTS)})`", lambda found: _REQUESTS[found[1]], join_lines(text))


def describe_problem(path: str, status: int, detail: str, title: str | None = None) -> dict[str, Any]:
    """Returns a problem (`routes.schemas`) at `path`, of which it has `MOST_PATH` characters at most.

    Without a `title` it is HTTP's own, of the type about:blank.
    """
    return {
        "type": "about:blank" if title is None else "urn:ciir:" + title.lower().replace(" ", "-"),
        "title": title or HTTPStatus(status).phrase,
        "status": status,
        "detail": format_message(detail),
        "instance": path[:MOST_PATH],
    }


def respond_problem(
    path: str, status: int, detail: str, *, title: str | None = None, headers: Mapping[str, str] | None = None
) -> JSONResponse:
    """Responds with that problem. A 503 gets a `Retry-After`."""
    again = {"Retry-After": RETRY_SECONDS} if status == 503 else {}
    return JSONResponse(describe_problem(path, status, detail, title), status, again | dict(headers or {}), MEDIA_TYPE)


def respond_error(error: Error, path: str, retry_after: str = RETRY_SECONDS) -> JSONResponse:
    """Responds with the problem for `error`. The details of an error of the server only go to its log.

    `retry_after`: seconds, for a 503.
    """
    row = find_response(error)
    detail = str(error)
    if row.status == 500:
        _log.error("%s: %s", type(error).__name__, detail)
        detail = SERVER_ERROR
    if isinstance(error, QueueFull):
        retry_after = str(error.retry_after)
    headers = {"Retry-After": retry_after} if row.status in (429, 503) else None
    return respond_problem(path, row.status, detail, title=row.title, headers=headers)


def add_handlers(app: FastAPI) -> None:
    """Makes `app` report errors as problems. `middleware.tracking` reports all other exceptions."""
    app.add_exception_handler(Error, _handle_error)
    app.add_exception_handler(HTTPException, _handle_http)
    app.add_exception_handler(ClientDisconnect, _handle_disconnect)


async def _handle_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, Error)  # noqa: S101 - only registered for this class
    return respond_error(error, request.url.path)


async def _handle_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 - only registered for this class
    detail = error.detail
    if detail == HTTPStatus(error.status_code).phrase:  # the framework's default, which only repeats the title
        detail = _DETAILS.get(error.status_code, detail)
    headers = _list_methods(request) if error.status_code == 405 else error.headers
    return respond_problem(request.url.path, error.status_code, detail, headers=headers)


def _list_methods(request: Request) -> dict[str, str]:
    """Returns `Allow` with the methods of all routes at the path. The framework lists only those of one route."""
    methods = [
        method
        for method in METHODS
        if any(route.matches({**request.scope, "method": method})[0] is Match.FULL for route in request.app.routes)
    ]
    return {"Allow": ", ".join(methods or ("GET", "HEAD"))}  # no route matches below a mounted folder of files


async def _handle_disconnect(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001
    """Returns a response that no client receives. Without it the log would have a traceback."""
    return respond_problem(request.url.path, 400, "the client disconnected before its request was complete")
