"""uvicorn's HTTP/1.1 protocol with timeouts for slow clients, a limit on connections, and strict framing.

uvicorn has no setting for how long a client may take to send a head or to read a response, and none for the response to
bytes that are not HTTP; its `limit_concurrency` closes no idle connection. `service.web.middleware.body_limit` limits
the time for a body.
"""

from __future__ import annotations

import logging
import re
import sys
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from ciir.service.web.middleware.framing import BLANK_LINE, StrictConnection
from ciir.service.web.middleware.refusal import Refusal

if TYPE_CHECKING:
    import asyncio

    from ciir.service.metrics import Metrics

SPARE = 4
"""Connections over the limit whose head is read: those that ask for /healthz are answered, so that no slow uploads make
a healthy server look dead."""
SPARE_SECONDS = 1.0
"""Time for that head."""
SPARE_BYTES = 2**14
"""Most bytes of that head."""
_HEALTH = re.compile(rb"(GET|HEAD) /healthz[? ]")
_REPR = re.compile(r"(?:bytearray\()?\bb(([\"']).*\2)\)?")
"""Bytes as shown in h11's messages."""
_BARE_LINE = "Invalid HTTP request received."
"""uvicorn's log line without a cause; `Refusal.log` logs a better one."""


class TimeoutProtocol(H11Protocol):
    """Aborts a connection when the client takes longer than `seconds` for its part.

    The client's part is to complete the head of a request, to read part of a response, or to read the rest when the
    connection is closed. Bytes that are not HTTP are answered with a problem.
    """

    seconds: ClassVar[float]
    most: ClassVar[int]
    """Most connections."""
    metrics: ClassVar[Metrics]
    idle: ClassVar[dict[TimeoutProtocol, None]]
    """Connections between two requests, or before the first. The one that has been idle for longest comes first.

    All four are set in a subclass by `make_protocol`.
    """
    conn: StrictConnection
    _head_timer: asyncio.TimerHandle | None = None
    _write_timer: asyncio.TimerHandle | None = None
    _spare_head: bytes | None = None
    """What was received by a connection over the limit, until its head is complete; None for any other."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.conn = StrictConnection(h11.SERVER)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Starts the timer for the first head. Over the limit on connections, it ends an idle one, or this one."""
        super().connection_made(transport)
        self._head_timer = self._start_timer()
        if len(self.connections) > self.most and not self.idle:
            self._begin_spare()
            return
        if len(self.connections) > self.most:
            oldest = next(iter(self.idle))
            del self.idle[oldest]
            oldest.transport.abort()
        self.idle[self] = None

    def _begin_spare(self) -> None:
        """Waits for the head of a connection over the limit, or refuses it if too many others wait."""
        if len(self.connections) > self.most + SPARE:
            self._refuse_for_limit()
            return
        self._spare_head = b""
        _cancel(self._head_timer)
        self._head_timer = self.loop.call_later(SPARE_SECONDS, self._refuse_for_limit)

    def _read_spare(self, data: bytes) -> None:
        """Reads the head of a connection over the limit. Passes it on if it asks for /healthz, and refuses others."""
        self._spare_head = head = (self._spare_head or b"") + data
        if BLANK_LINE.search(head) is None and len(head) <= SPARE_BYTES:
            return
        if _HEALTH.match(head) is None and len(self.connections) > self.most:
            self.conn.head = head
            self._refuse_for_limit()
            return
        _cancel(self._head_timer)
        self._spare_head = self._head_timer = None
        self.data_received(head)

    def _refuse_for_limit(self) -> None:
        _cancel(self._head_timer)
        self._refuse(503, f"the server has {self.most} connections open; try again in a second")

    def connection_lost(self, exc: Exception | None) -> None:
        """Stops the timers."""
        _cancel(self._head_timer, self._write_timer)
        self.idle.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Starts the timer for a head with its first byte, and stops it when the head is complete."""
        if self._spare_head is not None:
            self._read_spare(data)
            return
        super().data_received(data)
        if not self._is_between_requests():
            _cancel(self._head_timer)
            self._head_timer = None
            self.idle.pop(self, None)
        elif self._head_timer is None:
            self._head_timer = self._start_timer()

    def on_response_complete(self) -> None:
        """Makes the connection idle, unless the next request has already arrived."""
        super().on_response_complete()
        if self._is_between_requests() and not self.transport.is_closing():
            self.idle[self] = None

    def _is_between_requests(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

    def pause_writing(self) -> None:
        """Starts a timer, because the client reads more slowly than the server writes."""
        super().pause_writing()
        self._write_timer = self._write_timer or self._start_timer()

    def resume_writing(self) -> None:
        """Stops the timer, because the client has read most of what was written."""
        super().resume_writing()
        _cancel(self._write_timer)
        self._write_timer = None

    def timeout_keep_alive_handler(self) -> None:
        """Closes an idle connection. A timer aborts it if the client does not read the rest."""
        super().timeout_keep_alive_handler()
        self._write_timer = self._write_timer or self._start_timer()

    def send_400_response(self, msg: str) -> None:
        """Answers bytes that are not HTTP with a problem, unless a response has begun."""
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.abort()
            return
        cause = _REPR.sub(r"\1", str(sys.exception() or msg.rstrip("."))).replace("\\r\\n", "")[:120]
        self._refuse(400, f"{cause}; send HTTP/1.1 as RFC 9112 defines it")

    def _refuse(self, status: int, detail: str) -> None:
        """Answers with a problem, logs it and closes the connection."""
        refusal = Refusal(self.conn.head, status, detail)
        refusal.log("{}:{}".format(*self.client) if self.client else "-")
        if self._is_between_requests():  # the application counts a request whose body is broken
            refusal.count(self.metrics)
        headers, body = refusal.write()
        response = h11.Response(status_code=status, headers=headers, reason=HTTPStatus(status).phrase.encode())
        for event in (response, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _start_timer(self) -> asyncio.TimerHandle:
        return self.loop.call_later(self.seconds, self.transport.abort)


def _cancel(*timers: asyncio.TimerHandle | None) -> None:
    for timer in timers:
        if timer is not None:
            timer.cancel()


def _is_not_bare(record: logging.LogRecord) -> bool:
    return record.msg != _BARE_LINE


def make_protocol(seconds: float, most: int, metrics: Metrics) -> type[TimeoutProtocol]:
    """Makes a `TimeoutProtocol` with that timeout and at most that many connections.

    `metrics` counts what it refuses.
    """
    logging.getLogger("uvicorn.error").addFilter(_is_not_bare)
    attributes = {"seconds": seconds, "most": most, "metrics": metrics, "idle": {}}
    return type("TimeoutProtocol", (TimeoutProtocol,), attributes)
