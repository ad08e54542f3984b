"""Limits on request bodies in bytes and in seconds, with and without a declared length.

Starlette's `RequestBodyLimitMiddleware` (FastAPI's `max_body_size`) answers in plain text, reads the rest of a refused
body and has no time limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import anyio
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.routing import Match

from ciir.errors import NotReady, TooLarge
from ciir.service.jobs.engine import STOPPING
from ciir.service.web import problems

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LINGER_SECONDS = 1.0
"""How long the rest of a refused body is read and dropped. A client that is cut off while it writes would see a broken
connection instead of the response."""
OTHER_BYTES = 4096
"""Maximum bytes of a body that is sent to a path without its own limit."""


class BodyLimit:
    """ASGI middleware that limits request bodies.

    A declared length over the limit is answered with 413 before anything is read, except when the path or the method is
    wrong: that is 404 or 405. For a chunked body `receive` raises `TooLarge` at the first byte over the limit. After
    `seconds`, `receive` raises `HTTPException` 408, and `NotReady` once `protocol` ends uploads because the server
    stops. If a body has not been read to its end, the response closes the connection.
    """

    def __init__(self, app: ASGIApp, limits: Mapping[str, int], seconds: float) -> None:
        """`limits`: maximum bytes by path; `OTHER_BYTES` for all other paths."""
        self._app, self._limits, self._seconds = app, limits, seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = self._limits.get(scope["path"], OTHER_BYTES)
        headers = Headers(scope=scope)
        declared = headers.get("content-length", "")
        length = int(declared) if declared.isdecimal() else 0
        is_read = length == 0 and "transfer-encoding" not in headers
        read = 0
        end = anyio.current_time() + self._seconds

        async def receive_counted() -> Message:
            nonlocal read, is_read
            if is_read:  # only the client's disconnect can follow
                return await receive()
            with anyio.CancelScope(deadline=end) as waiting:
                message = await receive()
            if waiting.cancelled_caught:
                raise HTTPException(
                    408,
                    f"the request's body was not complete after {self._seconds:g} s; send a smaller file, or faster",
                )
            read += len(message.get("body", b""))
            is_read = not message.get("more_body", False)
            if not is_read and scope.get("state", {}).get("is_stopping"):
                raise NotReady(STOPPING)
            if read > limit:
                raise _make_error(limit)
            return message

        async def send_closing(message: Message) -> None:
            if message["type"] == "http.response.start" and not is_read:
                if "expect" not in headers or read:  # a client that sent Expect waits, and sends no body after a 413
                    await _drop_rest(receive)
                message["headers"] = [*message["headers"], (b"connection", b"close")]
            await send(message)

        if length > limit and _has_route(scope):
            await problems.respond_error(_make_error(limit), scope["path"])(scope, receive, send_closing)
        else:
            await self._app(scope, receive_counted, send_closing)


def _has_route(scope: Scope) -> bool:
    return any(route.matches(scope)[0] is Match.FULL for route in scope["app"].routes)


def _make_error(limit: int) -> TooLarge:
    return TooLarge(f"the request's body is over the limit of {limit:,} bytes; send a smaller file")


async def _drop_rest(receive: Receive) -> None:
    with anyio.move_on_after(LINGER_SECONDS):
        while (await receive()).get("more_body", False):
            pass
