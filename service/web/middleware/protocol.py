"""uvicorn's HTTP/1.1 protocol with timeouts for slow clients, a limit on connections, and strict framing.

uvicorn has no setting for how long a client may take to send a head or to read a response, and none for the response to
bytes that are not HTTP; its `limit_concurrency` closes no idle connection. `service.web.middleware.body_limit` limits
the time for a body.
"""

from __future__ import annotations

import fcntl
import logging
import re
import sys
import termios
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
CHECKS = 10
"""Checks, within the time that a client may read nothing, of whether it has read anything."""
UPLOAD_SECONDS = 3.0
"""Time after the drain for a body to arrive. Then `body_limit` needs time for its response."""
RESPONSE_SECONDS = 5.0
"""Time after the drain for responses."""
_HEALTH = re.compile(rb"(GET|HEAD) /healthz[? ]")
_REPR = re.compile(r"(?:bytearray\()?\bb(([\"']).*\2)\)?")
"""Bytes as shown in h11's messages."""
_BARE_LINE = "Invalid HTTP request received."
"""uvicorn's log line without a cause; `Refusal.log` logs a better one."""
_log = logging.getLogger("ciir.access")


class TimeoutProtocol(H11Protocol):
    """Aborts a connection when the client takes longer than `seconds` for its part.

    The client's part is to complete the head of a request, to read any of a response, or to read any of the rest when
    the connection is closed. What the client's system has received counts as read. Bytes that are not HTTP are answered
    with a problem.
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
    _stop_timers: tuple[asyncio.TimerHandle, ...] = ()
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
        _cancel(self._head_timer, self._write_timer, *self._stop_timers)
        self._unset_keepalive_if_required()  # uvicorn does so only if there was no error
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
        self._watch_reading()

    def resume_writing(self) -> None:
        """Stops the timer, because the client has read most of what was written."""
        super().resume_writing()
        _cancel(self._write_timer)
        self._write_timer = None

    def timeout_keep_alive_handler(self) -> None:
        """Closes an idle connection. A timer aborts it if the client does not read the rest."""
        super().timeout_keep_alive_handler()
        self._watch_reading()

    def _watch_reading(self) -> None:
        if self._write_timer is None:
            self._check_reading(sys.maxsize, 0)

    def _check_reading(self, before: int, stalled: int) -> None:
        """Cuts the connection after `CHECKS` checks in a row in which the client has read nothing.

        `before`: its unread bytes at the last check. `stalled`: the number of such checks so far.
        """
        unread = _count_unread(self.transport)
        stalled = stalled + 1 if unread >= before else 0
        if stalled == CHECKS:
            self._cut(f"the client read nothing for {self.seconds:g} s")
        else:
            self._write_timer = self.loop.call_later(self.seconds / CHECKS, self._check_reading, unread, stalled)

    def shutdown(self) -> None:
        """Closes an idle connection at the end of the drain. A request on any other has some seconds to end."""
        super().shutdown()
        self._stop_timers = (
            self.loop.call_later(UPLOAD_SECONDS, self._end_upload),
            self.loop.call_later(RESPONSE_SECONDS, self._cut, "the server stopped"),
        )

    def _end_upload(self) -> None:
        """Makes `body_limit` refuse a body that is not complete."""
        if not self._is_between_requests() and self.cycle.more_body:
            self.cycle.scope["state"]["is_stopping"] = True
            self.cycle.message_event.set()

    def _cut(self, cause: str) -> None:
        """Aborts the connection, with the cause in the log line of its request."""
        if self._is_between_requests():  # the line is written already
            _log.info("cut the connection to %s: %s", self._name_client(), cause)
        else:
            self.cycle.scope["state"]["cut"] = cause
        self.transport.abort()

    def _name_client(self) -> str:
        return "{}:{}".format(*self.client) if self.client else "-"

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
        refusal.log(self._name_client())
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


def _count_unread(transport: asyncio.Transport) -> int:
    """Counts the bytes of responses that the client's system has not received."""
    buffered = transport.get_write_buffer_size()
    try:
        queued = fcntl.ioctl(transport.get_extra_info("socket"), termios.TIOCOUTQ, bytes(4))  # SIOCOUTQ has its number
    except OSError:  # not Linux: only what leaves the transport's buffer counts, so that a slow client may be cut
        return buffered
    return buffered + int.from_bytes(queued, sys.byteorder)


def _is_not_bare(record: logging.LogRecord) -> bool:
    return record.msg != _BARE_LINE


def make_protocol(seconds: float, most: int, metrics: Metrics) -> type[TimeoutProtocol]:
    """Makes a `TimeoutProtocol` with that timeout and at most that many connections.

    `metrics` counts what it refuses.
    """
    logging.getLogger("uvicorn.error").addFilter(_is_not_bare)
    attributes = {"seconds": seconds, "most": most, "metrics": metrics, "idle": {}}
    return type("TimeoutProtocol", (TimeoutProtocol,), attributes)
