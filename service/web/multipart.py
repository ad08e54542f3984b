"""Parses forms, with a remedy in each error message: multipart/form-data (RFC 7578), and without files also urlencoded.

Starlette has no setting that refuses a body without its closing boundary, and would silently lose the last part.
"""

from __future__ import annotations

import logging
from contextlib import aclosing
from tempfile import gettempdir
from typing import TYPE_CHECKING
from urllib.parse import unquote_to_bytes

from python_multipart.multipart import DEFAULT_MAX_HEADER_SIZE, parse_options_header
from starlette.exceptions import HTTPException
from starlette.formparsers import FormParser, MultiPartException, MultiPartParser

from ciir.errors import NoRoom
from ciir.renderer.readers.names import clean_text
from ciir.renderer.writers.options import TEXT_FILES
from ciir.service.jobs.resource import DISK_FULL, is_full

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator

    from starlette.datastructures import FormData
    from starlette.requests import Request

MULTIPART, URLENCODED = "multipart/form-data", "application/x-www-form-urlencoded"
CHARSETS = ("utf-8", "us-ascii")
MAX_FIELD_BYTES = 64 * 2**10
"""Maximum bytes of a field other than the file, and of an urlencoded form: enough to name thousands of views."""
MAX_FIELDS = 64
MAX_FILES = 1 + len(TEXT_FILES)
_log = logging.getLogger("ciir")
_TRUNCATED = "The multipart body ends before its closing boundary."
_LONG_HEADER = f"A header of a part is over {DEFAULT_MAX_HEADER_SIZE:,} bytes, the limit"
_NO_TEXT = f"A form of the type {URLENCODED} is UTF-8 text of up to {MAX_FIELD_BYTES:,} bytes"
_REMEDIES = {  # the beginning of a message -> its remedy
    _TRUNCATED: "send the whole body",
    _LONG_HEADER: "give the file a shorter name",
    _NO_TEXT: f"send a file, and a longer form, as {MULTIPART} (curl -F file=@NAME)",
    "Invalid multipart data": "send a form as HTTP clients make it, such as curl -F file=@NAME",
    "Missing boundary": "let the HTTP client write the Content-Type with its boundary",
    "The Content-Disposition": "send a form as HTTP clients make it, such as curl -F file=@NAME",
    "Too many files": "send one file, or a zip of several, and the files of options once",
    "Too many fields": "send each option once",
    "Part exceeded": "send large content as the file, with a file name, and name fewer views",
}


async def read_form(request: Request) -> FormData:
    """Reads the fields of the body, of which up to `MAX_FILES` are files.

    The caller closes the form. Large parts are on disk.

    Raises `HTTPException` 400 for a broken body or a charset other than UTF-8, and `NoRoom` if the disk is full.
    """
    kind, options = parse_options_header(request.headers["content-type"])
    charset = options.get(b"charset", b"utf-8").decode("latin-1")
    if charset.lower() not in CHARSETS:
        raise HTTPException(400, f"charset={clean_text(charset)[:40]}: not supported; send the form in UTF-8")

    async def check_size() -> AsyncGenerator[bytes, None]:
        read = 0
        async for chunk in request.stream():
            read += len(chunk)
            if isinstance(parser, FormParser) and read > MAX_FIELD_BYTES:
                raise MultiPartException(_NO_TEXT)
            yield chunk
        if isinstance(parser, _Parser) and not parser.is_complete:
            raise MultiPartException(_TRUNCATED)

    chunks = check_size()
    parser: FormParser | _Parser = (
        _UrlencodedParser(request.headers, chunks, max_fields=MAX_FIELDS)
        if kind == URLENCODED.encode()
        else _Parser(request.headers, chunks, max_files=MAX_FILES, max_fields=MAX_FIELDS, max_part_size=MAX_FIELD_BYTES)
    )
    try:
        async with aclosing(chunks):
            return await parser.parse()
    except MultiPartException as error:
        cause = _LONG_HEADER if "header size" in str(error.__cause__) else error.message
        remedy = next((remedy for start, remedy in _REMEDIES.items() if cause.startswith(start)), None)
        detail = cause if remedy is None else f"{cause.rstrip('.')}; {remedy}"
        raise HTTPException(400, detail) from error
    except OSError as error:
        if not is_full(error):
            raise
        _log.warning("an upload can't be kept in %s (TMPDIR): %s", gettempdir(), error.strerror)
        raise NoRoom(DISK_FULL) from error


class _Parser(MultiPartParser):
    """Starlette's parser, which also notes whether the closing boundary has arrived."""

    is_complete = False

    def on_end(self) -> None:
        self.is_complete = True


class _UrlencodedParser(FormParser):
    """Starlette's parser, but for UTF-8, also if it isn't percent-encoded (`curl -d`), and without NUL characters."""

    def on_field_end(self) -> None:
        super().on_field_end()
        parts = (bytes(part).replace(b"+", b" ") for part in (self._field_name, self._field_value))
        try:
            name, value = (unquote_to_bytes(part).decode() for part in parts)
        except UnicodeDecodeError as error:
            raise MultiPartException(_NO_TEXT) from error
        if "\0" in name + value:
            raise MultiPartException(_NO_TEXT)
        self._items[-1] = (name, value)
