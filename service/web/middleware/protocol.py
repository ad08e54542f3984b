"""uvicorn's HTTP/1.1 protocol for clients that can't be trusted to go on: each has a time in which to do its part.

uvicorn itself waits for ever for the end of a request's head, and for a client to take what is sent. How long a body
may take is in `service.web.middleware.body_limit`, where an answer can still be given.
"""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import TYPE_CHECKING, ClassVar
from uuid import uuid4

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from ciir.service.web import problems

if TYPE_CHECKING:
    import asyncio


class TimeoutProtocol(H11Protocol):
    """Cuts a connection off `seconds` after a request's head was begun and is not whole, after the client stopped to
    take its answer, and after it was closed here with bytes left that nobody takes. It answers what isn't HTTP with a
    problem.
    """

    seconds: ClassVar[float] = 30.0
    """Set in a subclass: see `within`."""
    _head: asyncio.TimerHandle | None = None
    _taking: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A client is there, and its first head is awaited."""
        super().connection_made(transport)
        self._head = self._timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """The end."""
        _stop(self._head, self._taking)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """A part of a head or of a body."""
        super().data_received(data)
        is_between_requests = self.cycle is None or self.cycle.response_complete
        if not is_between_requests:
            _stop(self._head)
            self._head = None
        elif self._head is None:
            self._head = self._timer()

    def pause_writing(self) -> None:
        """There is more to send than the client takes."""
        super().pause_writing()
        self._taking = self._taking or self._timer()

    def resume_writing(self) -> None:
        """The client took most of it."""
        super().resume_writing()
        _stop(self._taking)
        self._taking = None

    def timeout_keep_alive_handler(self) -> None:
        """Nothing more was asked for."""
        super().timeout_keep_alive_handler()
        self._taking = self._taking or self._timer()

    def send_400_response(self, msg: str) -> None:
        """What came is not HTTP: `msg` says so."""
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):  # an answer is on its way already
            self.transport.abort()
            return
        body = json.dumps(
            {
                "type": "about:blank",
                "title": HTTPStatus.BAD_REQUEST.phrase,
                "status": 400,
                "detail": f"{msg.rstrip('.')}; send HTTP/1.1 as RFC 9112 has it",
                "instance": "",  # nobody knows what was asked for
            }
        ).encode()
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

    def _timer(self) -> asyncio.TimerHandle:
        return self.loop.call_later(self.seconds, self.transport.abort)


def _stop(*timers: asyncio.TimerHandle | None) -> None:
    for timer in timers:
        if timer is not None:
            timer.cancel()


def make_protocol(seconds: float) -> type[TimeoutProtocol]:
    """The protocol with that much patience."""
    return type("TimeoutProtocol", (TimeoutProtocol,), {"seconds": seconds})
