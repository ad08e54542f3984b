"""The form of a reconstruction: a file, the options by name, and the format of the result."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, BinaryIO

from starlette.datastructures import UploadFile

from ciir.errors import InvalidOption, UnsupportedType
from ciir.renderer.readers.names import clean_text
from ciir.renderer.writers.formats import FORMATS, check_format
from ciir.service.jobs.job import Request
from ciir.service.pipeline.options import HELP, NAMES, Options

if TYPE_CHECKING:
    from collections.abc import Iterable

FILE, FORMAT = "file", "format"

SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": [FILE],
    "additionalProperties": False,
    "properties": {
        FILE: {"type": "string", "format": "binary", "description": "a mesh, an EIA picture, or a zip of views"},
        FORMAT: {"type": "string", "enum": list(FORMATS), "description": "default: png for one view, else zip"},
    }
    | {name: {"type": "string", "description": f"{HELP[name][0]}: {HELP[name][1]}"} for name in NAMES},
}
"""JSON schema of the form, for OpenAPI."""


@dataclass(frozen=True)
class Upload:
    """A parsed form."""

    request: Request
    file: BinaryIO
    size: int
    """Bytes."""


def check_content_type(content_type: str | None) -> None:
    """Raises `UnsupportedType` unless the body is declared as multipart/form-data."""
    kind = (content_type or "").partition(";")[0].strip().lower()
    if kind != "multipart/form-data":
        given = repr(kind[:60]) if kind else "nothing"
        raise UnsupportedType(f"the body's type is {given}; send multipart/form-data with the part {FILE!r}")


def parse_form(parts: Iterable[tuple[str, UploadFile | str]]) -> Upload:
    """Parses the parts of a form. Raises `InvalidOption` for one that is unknown, repeated, missing or out of range."""
    upload: UploadFile | None = None
    texts: dict[str, str] = {}
    seen: set[str] = set()
    for name, value in parts:
        if name in seen:
            raise InvalidOption(f"{clean_text(name)}: given twice; give it once")
        seen.add(name)
        if name == FILE:
            if not isinstance(value, UploadFile):
                raise InvalidOption(f"{FILE}: a plain field; send it as a file, with a file name")
            upload = value
        elif isinstance(value, UploadFile):
            raise InvalidOption(f"{clean_text(name)}: a file; only {FILE!r} may be one, send this as a plain field")
        elif value.strip() or name not in (*NAMES, FORMAT):  # web forms send empty fields too
            texts[name] = value
    format_ = texts.pop(FORMAT, None)
    unknown = sorted(set(texts) - set(NAMES))
    if unknown:
        listed = ", ".join(repr(clean_text(name)[:40]) for name in unknown[:5])
        raise InvalidOption(f"{listed}: no such field; the fields are {', '.join((FILE, FORMAT, *NAMES))}")
    if format_ is not None:
        check_format(format_)
    Options.parse(texts)  # raises for one that is out of range
    if upload is None:
        raise InvalidOption(f"{FILE}: missing; send a mesh, an EIA picture or a zip of views as the part {FILE!r}")
    request = Request("upload" + _find_suffix(upload.filename or ""), texts, format_)
    return Upload(request, upload.file, upload.size or 0)


def _find_suffix(name: str) -> str:
    suffix = PurePosixPath(name.replace("\\", "/")).suffix.lower()
    return suffix if re.fullmatch(r"\.[a-z0-9]{1,8}", suffix) else ""
