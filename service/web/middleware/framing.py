"""Strict framing: refuses a head whose length a proxy might read differently, because it could hide a request."""

from __future__ import annotations

import re
from typing import Any

import h11

BLANK_LINE = re.compile(rb"\r?\n\r?\n")
_FOLDED = re.compile(rb"\n[ \t]")
_LENGTH = re.compile(rb"^content-length:[ \t]*(.*?)[ \t]*\r?$", re.IGNORECASE | re.MULTILINE)
_ENCODING = re.compile(rb"^transfer-encoding:", re.IGNORECASE | re.MULTILINE)


class StrictConnection(h11.Connection):
    """h11's connection, without what h11 accepts although RFC 9112 requires refusing it (see `find_framing_error`)."""

    head = b""
    """The head of the last request, as far as it was received."""

    def next_event(self) -> Any:
        """Returns h11's next event. Raises `h11.RemoteProtocolError` also for a head with a framing error."""
        if self.their_state is h11.IDLE:
            self.head = BLANK_LINE.split(self.trailing_data[0], maxsplit=1)[0]
        event = super().next_event()
        if isinstance(event, h11.Request) and (error := find_framing_error(self.head)):
            raise h11.RemoteProtocolError(error)
        return event


def find_framing_error(head: bytes) -> str | None:
    """Returns what is wrong with the head of a request (RFC 9112, 5.2, 6.1 and 6.3), or None."""
    lengths = _LENGTH.findall(head)
    if _FOLDED.search(head):
        return "a header continues on a second line"
    if lengths and _ENCODING.search(head):
        return "Content-Length and Transfer-Encoding are both given"
    if len(lengths) > 1 or not all(length.isdigit() for length in lengths):
        return "Content-Length is not a single number"
    return None
