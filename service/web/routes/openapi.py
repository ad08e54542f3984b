"""OpenAPI descriptions of headers and responses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ciir.service.pipeline.options import FILE_TYPES
from ciir.service.web import problems
from ciir.service.web.routes import results, schemas
from ciir.service.web.routes.document import make_schemas, to_openapi_3_0

if TYPE_CHECKING:
    from fastapi import FastAPI

    from ciir.service.pipeline.options import Kind

Responses = dict[int | str, dict[str, Any]]

_PROBLEM = {problems.MEDIA_TYPE: {"schema": schemas.refer("Problem")}}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_ERRORS = {
    400: "the request is malformed",
    401: "the server has API keys, and the request sends none of them",
    403: "the Host is not one of the server's, or a web page of another origin sent the request",
    404: "there is no such job or file, or it was removed or has expired",
    408: "the body did not arrive in time",
    409: "the job is not done: it is waiting or running, or was cancelled",
    410: "the result, or what file_id names, is not kept any more, or was damaged; post the input again",
    413: "over a limit on bytes, pixels, files, triangles or memory",
    415: "not a form, or not a file of a supported type",
    416: "the result has none of the bytes that Range asks for",
    422: "an option or the content of the file is invalid",
    429: "too many jobs wait, or too many event streams are open; try again after Retry-After",
    503: "the server is starting or stopping, or its queue cannot be reached; try again after Retry-After",
}


def _header(description: str, kind: str = "string") -> dict[str, Any]:
    return {"description": description, "schema": {"type": kind}}


_ID = _header("id of the request: the one that was sent, or a new one")
_RETRY = _header("seconds", "integer")
_RESULT_HEADERS = {
    "X-Request-Id": _ID,
    "ETag": _header("in quotes: the job's id, - and the beginning of the file's SHA-256; the same for the same bytes"),
    "Content-Location": _header("path of the result"),
    "Server-Timing": _header("milliseconds of each stage; `stored` if a kept result was sent"),
    "X-Notes": _header("the notes of the report, as a JSON list in ASCII"),
}


def describe_errors(*statuses: int) -> Responses:
    """Describes problems with these statuses, with 403 wherever 401 is included, and `default` for any other."""
    found: Responses = {}
    for status in sorted({*statuses, 403} if 401 in statuses else statuses):
        found[status] = {"description": _ERRORS[status], "content": _PROBLEM, "headers": {"X-Request-Id": _ID}}
        if status in (429, 503):
            found[status]["headers"] = {"X-Request-Id": _ID, "Retry-After": _RETRY}
    return found | {"default": {"description": "any other error", "content": _PROBLEM}}


def describe_form(name: str) -> dict[str, Any]:
    """Describes the body of a request for a kind of job, or with a file to keep (`file`).

    Only as multipart, which generated clients can always send: with a second type they get a more complex call.
    """
    schema = schemas.refer(f"{name.title()}Form")
    return {"required": True, "content": {"multipart/form-data": {"schema": schema}}}


def describe_result(kind: Kind) -> Responses:
    """Describes 200 with the result, and 304 if the client has it."""
    headers = _RESULT_HEADERS | {results.name_id_header(kind.name): _header("the job's id")}
    return {
        200: {
            "description": f"the result, in one of the formats {', '.join(kind.formats)}",
            "content": {
                FILE_TYPES[name].media_type: _BINARY
                if name != "json"
                else {"schema": schemas.refer("InspectionReport")}
                for name in kind.formats
            },
            "headers": headers | {"Content-Disposition": _header("the file's name; a quilt's contains its layout")},
        },
        304: {"description": "the client has the result that If-None-Match names", "headers": headers},
    }


def describe_part(kind: Kind) -> Responses:
    """Describes 206 with a part of the result."""
    whole = describe_result(kind)[200]
    headers = whole["headers"] | {"Content-Range": _header("the bytes that are sent, and the size of the result")}
    return {206: whole | {"description": "the part of the result that Range asks for", "headers": headers}}


def describe_status(kind: Kind, code: int, description: str, **headers: str) -> Responses:
    """Describes a job's status as JSON. `headers` are as for `describe_json`."""
    return describe_json(code, description, schemas.refer(schemas.STATUSES[kind.name].__name__), **headers)


def describe_json(
    code: int, description: str, schema: dict[str, Any], media_type: str = "application/json", **headers: str
) -> Responses:
    """Describes a response of JSON, or of events with JSON. `headers` are descriptions by name, with `_` for `-`."""
    content = {media_type: {"schema": schema}}
    described = {name.replace("_", "-"): _header(text) for name, text in headers.items()}
    return {code: {"description": description, "content": content, "headers": {"X-Request-Id": _ID} | described}}


def describe_response(code: int, description: str, *media_types: str) -> Responses:
    """Describes a response of text, or without a body."""
    content: dict[str, Any] = {kind: {"schema": {"type": "string"}} for kind in media_types}
    response: dict[str, Any] = {"description": description, "headers": {"X-Request-Id": _ID}}
    return {code: response | {"content": content} if content else response}


def _parameter(name: str, description: str, example: str) -> dict[str, Any]:
    return {
        "name": name,
        "in": "header",
        "required": False,
        "description": description,
        "schema": {"type": "string"},
        "example": example,
    }


PREFER = _parameter(
    "Prefer", "`respond-async`: answer 202 immediately; `wait=N`: answer after at most N seconds", "respond-async"
)
RANGE = _parameter("Range", "send only these bytes of the result, in one part", "bytes=1000000-")
IF_RANGE = _parameter("If-Range", "with Range: the ETag of the result; if it has another one, send all of it", '"..."')
IF_NONE_MATCH = _parameter(
    "If-None-Match",
    "ETags of results that the client has",
    '"0123456789abcdef0123456789abcdef-0123456789abcdef0123456789abcdef"',
)
LAST_EVENT_ID = _parameter("Last-Event-ID", "number of the last event that the client has received", "3")


def add_schemas(app: FastAPI) -> None:
    """Adds the schemas that routes refer to to the document, which is made only once."""
    make = app.openapi

    def make_document() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = make()
            document["paths"] = to_openapi_3_0(document["paths"])
            document["components"]["schemas"] = make_schemas()
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = make_document  # type: ignore[method-assign]
