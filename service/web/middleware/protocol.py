"""uvicorn's HTTP/1.1 protocol with timeouts for slow clients.

uvicorn has no setting for how long a client may take to send a head or to read a response, and none for the response
to what is not HTTP. How long a body may take: `service.web.middleware.body_limit`.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, ClassVar
from uuid import uuid4

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from ciir.service.web import problems

if TYPE_CHECKING:
    import asyncio


class TimeoutProtocol(H11Protocol):
    """Aborts a connection when the client takes longer than `seconds` for its part.

    That is: to complete the head of a request, to read part of a response, or to read what is left when the connection
    is closed. Bytes that are not HTTP are answered with a problem.
    """

    seconds: ClassVar[float] = 30.0
    """Set in a subclass by `make_protocol`."""
    _head_timer: asyncio.TimerHandle | None = None
    _write_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Starts the timer of the first head."""
        super().connection_made(transport)
        self._head_timer = self._start_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stops the timers."""
        _cancel(self._head_timer, self._write_timer)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Starts the timer of a head with its first byte, and stops it when the head is complete."""
        super().data_received(data)
        is_between_requests = self.cycle is None or self.cycle.response_complete
        if not is_between_requests:
            _cancel(self._head_timer)
            self._head_timer = None
        elif self._head_timer is None:
            self._head_timer = self._start_timer()

    def pause_writing(self) -> None:
        """Starts a timer: the client reads more slowly than the server writes."""
        super().pause_writing()
        self._write_timer = self._write_timer or self._start_timer()

    def resume_writing(self) -> None:
        """Stops the timer: the client has read most of what was written."""
        super().resume_writing()
        _cancel(self._write_timer)
        self._write_timer = None

    def timeout_keep_alive_handler(self) -> None:
        """Closes an idle connection; a timer aborts it if the client does not read the rest."""
        super().timeout_keep_alive_handler()
        self._write_timer = self._write_timer or self._start_timer()

    def send_400_response(self, msg: str) -> None:
        """Answers bytes that are not HTTP with a problem, unless a response has begun."""
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.abort()
            return
        detail = f"{msg.rstrip('.')}; send HTTP/1.1 as RFC 9112 defines it"
        body = json.dumps(problems.describe_problem("", 400, detail)).encode()
        headers = [
            (b"content-type", problems.MEDIA_TYPE.encode()),
            (b"content-length", str(len(body)).encode()),
            (b"connection", b"close"),
            (b"x-content-type-options", b"nosniff"),
            (b"x-request-id", uuid4().hex.encode()),
        ]
        events = (h11.Response(status_code=400, headers=headers, reason=b"Bad Request"), h11.Data(data=body))
        for event in (*events, h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _start_timer(self) -> asyncio.TimerHandle:
        return self.loop.call_later(self.seconds, self.transport.abort)


def _cancel(*timers: asyncio.TimerHandle | None) -> None:
    for timer in timers:
        if timer is not None:
            timer.cancel()


def make_protocol(seconds: float) -> type[TimeoutProtocol]:
    """A `TimeoutProtocol` with that timeout."""
    return type("TimeoutProtocol", (TimeoutProtocol,), {"seconds": seconds})
