"""Limits on request bodies, in bytes and in time, that hold whether a length was declared or not.

FastAPI's own `max_body_size` answers a declared length in plain text and a chunked one in JSON; here both are problems,
and the connection is closed where the rest of a body would have to be read to find the next request.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import anyio
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException

from ciir.errors import TooLarge
from ciir.service.web import problems

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LINGER_SECONDS = 1.0
"""How long the rest of a refused body is read and thrown away. A client that is cut off while it still writes sees a
broken connection in place of the answer."""
OTHER_BYTES = 4096
"""Most bytes of a body that is sent to where none is needed."""


class BodyLimit:
    """ASGI middleware: 413 before anything is read where the declared length is over the path's limit; in a chunked
    body `TooLarge` from `receive` at the first byte over it, which the application answers as it answers any fault; and
    `HTTPException` 408 from `receive` where the body isn't whole after `seconds`.

    An answer to a body that is not at its end closes the connection.
    """

    def __init__(self, app: ASGIApp, limits: Mapping[str, int], seconds: float) -> None:
        """`limits`: most bytes, by path; `OTHER_BYTES` for all others."""
        self._app, self._limits, self._seconds = app, limits, seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes the request on with a `receive` that counts."""
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

        async def counted() -> Message:
            nonlocal read, is_read
            if is_read:  # what comes now is that the client has left
                return await receive()
            with anyio.CancelScope(deadline=end) as waiting:
                message = await receive()
            if waiting.cancelled_caught:
                raise HTTPException(
                    408,
                    f"the request's body was not whole after {self._seconds:g} s; send it quicker, or a smaller file",
                )
            read += len(message.get("body", b""))
            is_read = not message.get("more_body", False)
            if read > limit:
                raise _fault(limit)
            return message

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start" and not is_read:
                if "expect" not in headers or read:  # or the client waits for a word before it sends the body
                    await _drain(receive)
                message["headers"] = [*message["headers"], (b"connection", b"close")]
            await send(message)

        if length > limit:
            await problems.respond_error(_fault(limit), scope["path"])(scope, receive, answer)
        else:
            await self._app(scope, counted, answer)


def _fault(limit: int) -> TooLarge:
    return TooLarge(f"the request's body is over the limit of {limit:,} bytes; send a smaller file")


async def _drain(receive: Receive) -> None:
    with anyio.move_on_after(LINGER_SECONDS):
        while (await receive()).get("more_body", False):
            pass
