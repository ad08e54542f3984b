"""What the routes can answer, for OpenAPI."""

from __future__ import annotations

from typing import Any

from ciir.renderer.writers.formats import FORMATS
from ciir.service.web import problems
from ciir.service.web.routes import results

Responses = dict[int | str, dict[str, Any]]

_PROBLEM = {problems.MEDIA_TYPE: {"schema": problems.SCHEMA}}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_FAULTS = {
    400: "the request is broken",
    401: "the server has API keys, and none of them was sent",
    404: "there is no such job, or no more",
    408: "the body did not arrive in time",
    409: "the job is not done: it waits, it runs, or it was cancelled",
    410: "the result was kept for its time, and is gone; post it again",
    413: "over a limit on bytes, pixels, files, triangles or memory",
    415: "not multipart, or not a file of a kind that is read",
    422: "an option or the input's content is at fault",
    429: "too many jobs wait; Retry-After tells when to come again",
    503: "the server is starting or stopping, or its queue can't be reached; Retry-After tells when to come again",
}


def _header(text: str, kind: str = "string") -> dict[str, Any]:
    return {"description": text, "schema": {"type": kind}}


_ID = _header("of the request: the one that was given, or a new one")
_RETRY = _header("seconds", "integer")
_RESULT_HEADERS = {
    "X-Request-Id": _ID,
    "X-Reconstruction-Id": _header("the job's id"),
    "ETag": _header("the job's id in quotes; W/ before it where the file holds timings"),
    "Content-Location": _header("where the result is"),
    "Server-Timing": _header("milliseconds of each stage; `stored` where nothing had to be made"),
}


def describe_errors(*statuses: int) -> Responses:
    """Those answers, and that whatever else goes wrong is a problem, too."""
    found: Responses = {}
    for status in statuses:
        found[status] = {"description": _FAULTS[status], "content": _PROBLEM, "headers": {"X-Request-Id": _ID}}
        if status in (429, 503):
            found[status]["headers"] = {"X-Request-Id": _ID, "Retry-After": _RETRY}
    return found | {"default": {"description": "any other fault", "content": _PROBLEM}}


def describe_result() -> Responses:
    """200 with the result, 304 where the client has it."""
    return {
        200: {
            "description": "the views: one picture, a zip with report.json, or an npz",
            "content": {entry.media_type: _BINARY for entry in FORMATS.values()},
            "headers": _RESULT_HEADERS,
        },
        304: {"description": "If-None-Match names it: the client has it already", "headers": _RESULT_HEADERS},
    }


def describe_status(code: int, description: str, **headers: str) -> Responses:
    """A job's status as JSON."""
    told = {name.replace("_", "-"): _header(text) for name, text in headers.items()} | {"X-Request-Id": _ID}
    return {
        code: {
            "description": description,
            "content": {"application/json": {"schema": results.STATUS_SCHEMA}},
            "headers": told,
        }
    }


def describe_response(code: int, description: str, *media_types: str) -> Responses:
    """Any other answer."""
    content: dict[str, Any] = {kind: {"schema": {"type": "string"}} for kind in media_types}
    found: dict[str, Any] = {"description": description, "headers": {"X-Request-Id": _ID}}
    return {code: found | {"content": content} if content else found}


def describe_header(name: str, description: str, example: str) -> dict[str, Any]:
    """A request header that is read."""
    return {
        "name": name,
        "in": "header",
        "required": False,
        "description": description,
        "schema": {"type": "string"},
        "example": example,
    }


PREFER = describe_header(
    "Prefer", "`respond-async`: answer 202 at once; `wait=N`: after N seconds at most", "respond-async"
)
IF_NONE_MATCH = describe_header(
    "If-None-Match", "ETags of results that the client has", '"0123456789abcdef0123456789abcdef"'
)
LAST_EVENT_ID = describe_header("Last-Event-ID", "the number of the last event that was received", "3")
