"""Parses multipart/form-data bodies (RFC 7578), with a remedy in each error message.

Starlette has no setting that refuses a body without its closing boundary, and would silently lose the last part.
"""

from __future__ import annotations

import errno
from contextlib import aclosing
from typing import TYPE_CHECKING

from python_multipart.multipart import parse_options_header
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser

from ciir.errors import QueueUnavailable
from ciir.renderer.readers.names import clean_text
from ciir.renderer.writers.options import TEXT_FILES

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator

    from starlette.datastructures import FormData
    from starlette.requests import Request

CHARSETS = ("utf-8", "us-ascii")
MAX_FIELD_BYTES = 64 * 2**10
"""Maximum bytes of a field other than the file: enough to name thousands of views."""
MAX_FIELDS = 64
MAX_FILES = 1 + len(TEXT_FILES)
_TRUNCATED = "The multipart body ends before its closing boundary."
_REMEDIES = {  # the beginning of a message -> its remedy
    _TRUNCATED: "send the whole body",
    "Invalid multipart data": "send a form as HTTP clients make it, such as curl -F file=@NAME",
    "Missing boundary": "let the HTTP client write the Content-Type with its boundary",
    "The Content-Disposition": "send a form as HTTP clients make it, such as curl -F file=@NAME",
    "Too many files": "send one file, or a zip of several, and the files of options once",
    "Too many fields": "send each option once",
    "Part exceeded": "send large content as the file, with a file name, and name fewer views",
}


async def read_form(request: Request) -> FormData:
    """Reads the parts of the body, of which up to `MAX_FILES` are files.

    The caller closes the form. Large parts are on disk.

    Raises `HTTPException` 400 for a broken body or a charset other than UTF-8, and `QueueUnavailable` if the disk is
    full.
    """
    charset = parse_options_header(request.headers["content-type"])[1].get(b"charset", b"utf-8").decode("latin-1")
    if charset.lower() not in CHARSETS:
        raise HTTPException(400, f"charset={clean_text(charset)[:40]}: not supported; send the form in UTF-8")

    async def check_end() -> AsyncGenerator[bytes, None]:
        async for chunk in request.stream():
            yield chunk
        if not parser.is_complete:
            raise MultiPartException(_TRUNCATED)

    chunks = check_end()
    parser = _Parser(request.headers, chunks, max_files=MAX_FILES, max_fields=MAX_FIELDS, max_part_size=MAX_FIELD_BYTES)
    try:
        async with aclosing(chunks):
            return await parser.parse()
    except MultiPartException as error:
        remedy = next((remedy for start, remedy in _REMEDIES.items() if error.message.startswith(start)), None)
        detail = error.message if remedy is None else f"{error.message.rstrip('.')}; {remedy}"
        raise HTTPException(400, detail) from error
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise QueueUnavailable(
            "the server's disk has no space for the upload; try again later, or have its operator make space in TMPDIR"
        ) from error


class _Parser(MultiPartParser):
    """Starlette's parser, which also notes whether the closing boundary has arrived."""

    is_complete = False

    def on_end(self) -> None:
        self.is_complete = True
