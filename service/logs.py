"""Log lines of a server or a worker, as text or as JSON, each with the id of the request that it is about."""

from __future__ import annotations

import json
import logging
import time
from contextvars import ContextVar
from typing import Literal

REQUEST_ID: ContextVar[str] = ContextVar("request_id", default="-")
"""Of the request that this task or thread works for; `-` where it works for none."""
FIELDS = "fields"
"""Give `extra={FIELDS: {...}}` to a log call: JSON lines hold each by its name, text lines have its message alone."""
_TEXT = "%(asctime)s %(levelname)s %(name)s [%(request_id)s] %(message)s"


class _Text(logging.Formatter):
    def __init__(self) -> None:
        super().__init__(_TEXT)

    def format(self, record: logging.LogRecord) -> str:
        """A line; what a traceback adds comes on further ones."""
        record.request_id = REQUEST_ID.get()
        return super().format(record)


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """One object on one line: `time` (UTC), `level`, `logger`, `request_id`, `message`, the fields, `exception`."""
        seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        told = {
            "time": f"{seconds}.{int(record.msecs):03d}Z",
            "level": record.levelname,
            "logger": record.name,
            "request_id": REQUEST_ID.get(),
            "message": record.getMessage(),
        } | getattr(record, FIELDS, {})
        if record.exc_info:
            told["exception"] = self.formatException(record.exc_info)
        return json.dumps(told, ensure_ascii=False, default=str)


def configure(form: Literal["text", "json"]) -> None:
    """Sends all log lines of this process to stderr in that form, from INFO up; of its libraries from WARNING up."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Json() if form == "json" else _Text())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    for name in ("ciir", "uvicorn", "uvicorn.error"):
        logging.getLogger(name).setLevel(logging.INFO)
    logging.captureWarnings(capture=True)
