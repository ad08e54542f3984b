"""The id, security headers, log line and metrics of every request."""

from __future__ import annotations

import logging
import re
import time
from typing import TYPE_CHECKING
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders

from ciir.service.logs import FIELDS, REQUEST_ID
from ciir.service.web import problems

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from ciir.service.metrics import Metrics

SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}
"""Headers that a response gets unless it already has one with that name."""
ANY_FRAME = "frame-ancestors *"
"""Part of the Content-Security-Policy of a page that others may frame; `X-Frame-Options`, which can't express this, is
left out."""
UNLOGGED_PATHS = frozenset({"/healthz", "/readyz", "/metrics"})
"""Paths that machines request at short intervals: counted, but not logged."""
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_log = logging.getLogger("ciir.access")


def choose_id(given: str) -> str:
    """Returns the id of a request: the one in its `X-Request-Id`, if that is valid, or a new one."""
    return given if _ID.fullmatch(given) else uuid4().hex


def describe_client(scope: Scope) -> dict[str, str]:
    """Returns the fields of a log line that say who sent a request.

    `client` is the address. `key` is there if the request sent one of the server's API keys: the first 8 digits of the
    key's SHA-256.
    """
    address = scope["client"][0] if scope.get("client") else ""
    key = scope.get("state", {}).get("client", "")[:8]  # the whole digest is set by `api_keys.require_key`
    return {"client": address} | ({"key": key} if key else {})


class RequestTracking:
    """The outermost ASGI middleware. An exception that nothing else handles is answered with 500 and raised again."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start = time.perf_counter()
        id_ = choose_id(Headers(scope=scope).get("x-request-id", ""))
        REQUEST_ID.set(id_)  # the context belongs to this request's task, and ends with it
        status = sent = received = 0

        async def receive_counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            return message

        async def send_counted(message: Message) -> None:
            nonlocal status, sent
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers["X-Request-Id"] = id_
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if headers["Content-Security-Policy"].endswith(ANY_FRAME):
                    del headers["X-Frame-Options"]
            sent += len(message.get("body", b""))
            await send(message)

        try:
            await self._app(scope, receive_counted, send_counted)
        except Exception:
            if not status:
                response = problems.respond_problem(scope["path"], 500, problems.SERVER_ERROR)
                await response(scope, receive, send_counted)
            raise
        finally:
            self._record(scope, status, time.perf_counter() - start, received, sent)

    def _record(self, scope: Scope, status: int, seconds: float, received: int, sent: int) -> None:
        method = scope["method"] if scope["method"] in problems.METHODS else "other"
        route = getattr(scope.get("route"), "path", None) or "other"
        self._metrics.requests.labels(method, route, str(status)).inc()
        self._metrics.latency.labels(method, route).observe(seconds)
        self._metrics.received.inc(received)
        self._metrics.sent.inc(sent)
        path = scope.get("raw_path", b"").decode("ascii", "backslashreplace")[: problems.MOST_PATH]
        if path in UNLOGGED_PATHS:
            return
        milliseconds = round(1000 * seconds, 1)
        line = f"{method} {path} {status} {milliseconds} ms, {received} bytes in, {sent} out"
        fields = {"method": method, "path": path, "status": status, "ms": milliseconds} | describe_client(scope)
        fields |= {"bytes_in": received, "bytes_out": sent}
        if cut := scope.get("state", {}).get("cut"):  # set by `protocol`
            line, fields = f"{line}, cut: {cut}", fields | {"cut": cut}
        _log.info("%s", line, extra={FIELDS: fields})
