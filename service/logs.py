"""Log lines of a server or a worker as text or JSON, with the id of the request in each."""

from __future__ import annotations

import json
import logging
import time
from contextvars import ContextVar
from typing import Literal

REQUEST_ID: ContextVar[str] = ContextVar("request_id", default="-")
"""Id of the request that the current task or thread works on; `-` if there is none."""
FIELDS = "fields"
"""Key of `extra={FIELDS: {...}}` in a log call. JSON lines contain the fields, text lines only the message."""
_TEXT = "%(asctime)s %(levelname)s %(name)s [%(request_id)s] %(message)s"


def _add_request_id(record: logging.LogRecord) -> bool:
    """Adds the request's id to a line. A filter that lets every line through."""
    record.request_id = REQUEST_ID.get()
    return True


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """Formats an object: `time` (UTC), `level`, `logger`, `request_id`, `message`, fields, `exception`.

        For a message `job %s...` the field `job` is its first argument.
        """
        seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        entry = {
            "time": f"{seconds}.{int(record.msecs):03d}Z",
            "level": record.levelname,
            "logger": record.name,
            "request_id": REQUEST_ID.get(),
            "message": record.getMessage(),
        }
        if isinstance(record.args, tuple) and record.args and str(record.msg).startswith("job %s"):
            entry["job"] = str(record.args[0])
        entry |= getattr(record, FIELDS, {})
        if record.exc_info:
            entry["exception"] = self.formatException(record.exc_info)
        return json.dumps(entry, ensure_ascii=False, default=str)


def configure(form: Literal["text", "json"]) -> None:
    """Sends log lines to stderr: those of `ciir` and uvicorn from INFO up, those of libraries from WARNING up.

    Each malformed form has a line of its own, the request's, so warnings of the library that reads forms are left out.
    """
    handler = logging.StreamHandler()
    handler.addFilter(_add_request_id)
    handler.setFormatter(_Json() if form == "json" else logging.Formatter(_TEXT))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    for name in ("ciir", "uvicorn", "uvicorn.error"):
        logging.getLogger(name).setLevel(logging.INFO)
    logging.getLogger("python_multipart").setLevel(logging.ERROR)
    logging.captureWarnings(capture=True)
