"""A limit on request bodies that holds whether their length was declared or not, with one shape of answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import anyio
from starlette.datastructures import Headers

from renderer.errors import TooLarge
from service import problems

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LINGER_SECONDS = 1.0
"""How long the rest of a refused body is read and thrown away. A client that is cut off while it still writes sees a
broken connection in place of the answer."""


class BodyLimit:
    """ASGI middleware: 413 before anything is read where the declared length is over the limit; in a chunked body
    `TooLarge` from `receive` at the first byte over it, which the application answers as it answers any fault.

    An answer to a body that is over the limit, or that is chunked and not at its end, closes the connection: the server
    would read on, to find the next request behind it.
    """

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes the request on with a `receive` that counts."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        declared = headers.get("content-length", "")
        is_over = declared.isdecimal() and int(declared) > self._limit
        is_read = not is_over and "transfer-encoding" not in headers
        read = 0

        async def counted() -> Message:
            nonlocal read, is_read
            message = await receive()
            read += len(message.get("body", b""))
            is_read = is_read or not message.get("more_body", False)
            if read > self._limit:
                raise self._fault()
            return message

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start" and not is_read:
                if "expect" not in headers or read:  # or the client waits for a word before it sends the body
                    await _drain(receive)
                message["headers"] = [*message["headers"], (b"connection", b"close")]
            await send(message)

        if is_over:
            await problems.of(self._fault(), scope["path"])(scope, receive, answer)
        else:
            await self._app(scope, counted, answer)

    def _fault(self) -> TooLarge:
        return TooLarge(f"the request's body is over the limit of {self._limit:,} bytes; send a smaller file")


async def _drain(receive: Receive) -> None:
    with anyio.move_on_after(LINGER_SECONDS):
        while (await receive()).get("more_body", False):
            pass
