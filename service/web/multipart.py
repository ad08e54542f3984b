"""A multipart/form-data body to its parts (RFC 7578), and every way in which it can be broken in one line."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING

from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser

from ciir.errors import QueueUnavailable

if TYPE_CHECKING:
    from starlette.datastructures import FormData
    from starlette.requests import Request

MAX_FIELD_BYTES = 64 * 2**10
"""Most bytes of a field that isn't the file: thousands of views by name."""
MAX_FIELDS = 32
_TRUNCATED = "The multipart body ends before its closing boundary."
_REMEDIES = {  # how a fault's text begins -> what to do
    _TRUNCATED: "send the whole of it",
    "Invalid multipart data": "send a form as HTTP clients make it, such as curl -F file=@NAME",
    "Missing boundary": "let the HTTP client write the Content-Type, with its boundary",
    "The Content-Disposition": "send a form as HTTP clients make it, such as curl -F file=@NAME",
    "Too many files": "send one, a zip where there are several",
    "Too many fields": "send each option once",
    "Part exceeded": "send what is large as the file, with a file name, and fewer views by name",
}


async def read_form(request: Request) -> FormData:
    """The body's parts, of which one may be a file; to be closed. A large one goes through a temporary file.

    Raises `HTTPException` 400 where it is broken, and `QueueUnavailable` where the disk is full.
    """
    parser = _WholeParser(
        request.headers, request.stream(), max_files=1, max_fields=MAX_FIELDS, max_part_size=MAX_FIELD_BYTES
    )
    try:
        return await parser.parse()
    except MultiPartException as error:
        raise HTTPException(400, add_remedy(error.message)) from error
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        fault = "the server has no room for what you send; try again later, or have whoever runs it make room in TMPDIR"
        raise QueueUnavailable(fault) from error
    except (UnicodeError, LookupError) as error:  # the form's charset names no encoding, or not the one it is in
        raise HTTPException(400, "The multipart form is not in the charset that it names; send UTF-8") from error


def add_remedy(fault: str) -> str:
    """Starlette's text of a fault with the remedy."""
    remedy = next((remedy for start, remedy in _REMEDIES.items() if fault.startswith(start)), None)
    return fault if remedy is None else f"{fault.rstrip('.')}; {remedy}"


class _WholeParser(MultiPartParser):
    """Starlette's parser, which takes a body that was cut off for one without its last part, made to refuse it."""

    _is_whole = False

    def on_end(self) -> None:
        """Called at the closing boundary."""
        self._is_whole = True

    async def parse(self) -> FormData:
        """Raises `MultiPartException`, `OSError` where a temporary file can't be written, and what the body raises."""
        try:
            form = await super().parse()
        except BaseException:
            self._close()
            raise
        if not self._is_whole:
            self._close()
            raise MultiPartException(_TRUNCATED)
        return form

    def _close(self) -> None:
        for file in self._files_to_close_on_error:
            file.close()
