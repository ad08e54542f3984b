"""Responses to requests that never reach the application: broken framing, and connections over the limit."""

from __future__ import annotations

import json
import logging
import re
from typing import TYPE_CHECKING

from ciir.renderer.readers.names import clean_text
from ciir.service.logs import FIELDS, REQUEST_ID
from ciir.service.web import problems
from ciir.service.web.middleware.tracking import SECURITY_HEADERS, choose_id

if TYPE_CHECKING:
    from ciir.service.metrics import Metrics

_REQUEST_LINE = re.compile(r"\s*(\S{1,20}) (\S+) HTTP/")
_ID = re.compile(r"^x-request-id:[ \t]*(.*?)[ \t]*\r?$", re.IGNORECASE | re.MULTILINE)
_log = logging.getLogger("ciir.access")


class Refusal:
    """The response to a request of which only `head` is known: the bytes of its head, as far as they were received."""

    def __init__(self, head: bytes, status: int, cause: str) -> None:
        text = head.decode("latin-1")
        line, given = _REQUEST_LINE.match(text), _ID.search(text)
        method, target = line.groups() if line else ("", "")
        self.status, self._cause = status, cause
        self._id = choose_id(given.group(1) if given else "")
        self._method = method if method in problems.METHODS else "other"
        self._path = clean_text(target.partition("?")[0])

    def write(self) -> tuple[list[tuple[str, str]], bytes]:
        """Returns the headers and the body, which is a problem."""
        body = json.dumps(problems.describe_problem(self._path, self.status, self._cause)).encode()
        headers = SECURITY_HEADERS | {
            "Content-Type": problems.MEDIA_TYPE,
            "Content-Length": str(len(body)),
            "Connection": "close",
            "X-Request-Id": self._id,
        }
        if self.status == 503:
            headers["Retry-After"] = problems.RETRY_SECONDS
        return list(headers.items()), body

    def log(self, client: str) -> None:
        """Logs one line with the id, the client's address and the cause."""
        fields = {"method": self._method, "path": self._path, "status": self.status, "client": client}
        token = REQUEST_ID.set(self._id)
        line = f"refused {self._method} {self._path or '-'} from {client}: {self.status}, {self._cause}"
        _log.info("%s", line, extra={FIELDS: fields})
        REQUEST_ID.reset(token)

    def count(self, metrics: Metrics) -> None:
        """Counts the request, without a route."""
        metrics.requests.labels(self._method, "other", str(self.status)).inc()
