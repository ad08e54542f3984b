"""The form of a job: a file, a kept file or a shipped scene, the options by name, and the format of the result.

Options whose value is the text of a file can be sent as a file.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from starlette.datastructures import UploadFile

from ciir.errors import InvalidOption, UnsupportedType
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.readers.names import clean_text, is_eslf
from ciir.renderer.readers.registry import is_container, is_picture
from ciir.renderer.scenes import SCENES
from ciir.renderer.writers.options import MOST_TEXT, TEXT_FILES, decode_text
from ciir.service.jobs.job import Request
from ciir.service.pipeline.options import KINDS
from ciir.service.pipeline.source import SCENE as SCENE_PREFIX
from ciir.service.web.multipart import MULTIPART, URLENCODED

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from ciir.service.pipeline.options import Kind

FILE, FILE_ID, SCENE, FORMAT = "file", "file_id", "scene", "format"


@dataclass(frozen=True)
class Upload:
    """A parsed form."""

    request: Request
    file: BinaryIO
    size: int
    """Bytes."""
    file_id: str = ""
    """The kept file, or the finished job, that is the input: its name and bytes are still missing."""
    content: str = ""
    """SHA-256 of the file, if it is known."""


class _Input(NamedTuple):
    name: str
    """The name in a `Request`."""
    file: BinaryIO
    size: int
    file_id: str = ""


def check_head(query: Iterable[str], headers: Mapping[str, str]) -> None:
    """Raises `InputError` unless the head of a request declares a form as it is read here, without a query."""
    check_query(query)
    check_content_type(headers.get("content-type"))
    check_encoding(headers.get("content-encoding"))


def check_content_type(content_type: str | None) -> None:
    """Raises `UnsupportedType` unless the body is declared as a form."""
    kind = (content_type or "").partition(";")[0].strip().lower()
    if kind not in (MULTIPART, URLENCODED):
        given = f"the body's type is {kind[:60]!r}" if kind else "the body has no type"
        raise UnsupportedType(f"{given}; send {MULTIPART} with the part {FILE!r} (curl -F {FILE}=@NAME)")


def check_encoding(encoding: str | None) -> None:
    """Raises `UnsupportedType` for a body that is declared as compressed."""
    given = (encoding or "identity").strip().lower()
    if given != "identity":
        raise UnsupportedType(f"the body is compressed (Content-Encoding: {given[:60]!r}); send it as it is")


def check_query(names: Iterable[str]) -> None:
    """Raises `InvalidOption` if the URL has a query, whose parameters are called `names`."""
    if found := sorted(set(names)):
        listed = ", ".join(repr(clean_text(name)[:40]) for name in found[:5])
        raise InvalidOption(f"{listed}: in the URL's query, which is not read; send each as a field of the form")


def parse_form(parts: Iterable[tuple[str, UploadFile | str]], kind: Kind) -> Upload:
    """Parses the parts of a job's form.

    Raises `InvalidOption` for a part that is unknown, repeated, missing, out of range or not used by the format,
    `UnknownModel`, and `Unreadable` for a display's file that can't be read.
    """
    upload: UploadFile | None = None
    texts: dict[str, str] = {}
    seen: set[str] = set()
    for name, value in parts:
        if name in (FILE, *TEXT_FILES) and _is_left_empty(value):
            continue
        if name in seen:
            remedy = "send several files as one zip" if name == FILE else "give it once"
            raise InvalidOption(f"{clean_text(name)}: given twice; {remedy}")
        seen.add(name)
        if name == FILE:
            if not isinstance(value, UploadFile):
                raise InvalidOption(f"{FILE}: a plain field; send it as a file, with a file name")
            upload = value
        elif isinstance(value, UploadFile):
            files = [each for each in TEXT_FILES if each in kind.options]
            if name not in files:
                allowed = " and ".join(map(repr, (FILE, *files)))
                is_field = name in (*kind.options, *_list_others(kind))
                remedy = "send this as a plain field" if is_field else "use that name; send several as a zip"
                raise InvalidOption(f"{clean_text(name)[:40]}: a file; only {allowed} may be one, {remedy}")
            texts[name] = decode_text(value.file.read(MOST_TEXT + 1), name)
        elif value.strip() or name not in (*kind.options, *_list_others(kind)):  # web forms send empty fields too
            texts[name] = value
    format_ = texts.pop(FORMAT, None)
    scene = texts.pop(SCENE, None) if kind.takes_scenes else None
    file_id = texts.pop(FILE_ID, None)
    unknown = sorted(set(texts) - set(kind.options))
    if unknown:
        listed = ", ".join(repr(clean_text(name)[:40]) for name in unknown[:5])
        fields = ", ".join((FILE, *_list_others(kind), *kind.options))
        raise InvalidOption(f"{listed}: no such field; the fields are {fields}")
    if format_ is not None and format_ not in kind.formats:
        others = "".join(f", or POST to /v1/{other.plural}" for other in KINDS.values() if format_ in other.formats)
        raise InvalidOption(f"{FORMAT}: {format_[:40]!r} is not known; give {', '.join(kind.formats)}{others}")
    options = kind.parse(texts)
    kind.check_model(options.model)
    kind.check_format(options, format_)
    found = _find_input(upload, file_id, scene, kind)
    return Upload(Request(found.name, texts, format_, kind.name), found.file, found.size, found.file_id)


def parse_file(parts: Iterable[tuple[str, UploadFile | str]]) -> tuple[str, BinaryIO]:
    """Returns the name and the content of a file that is sent to be kept. Raises `InvalidOption` for any other form."""
    found = list(parts)
    upload = found[0][1] if found and found[0][0] == FILE else None
    if len(found) != 1 or not isinstance(upload, UploadFile) or _is_left_empty(upload):
        names = ", ".join(repr(clean_text(name)[:40]) for name, _ in found[:5]) or "nothing"
        raise InvalidOption(f"the form has {names}; send one part {FILE!r} with a file name, and nothing else")
    return make_name(upload.filename or "", takes_light_fields=True), upload.file


def _is_left_empty(value: UploadFile | str) -> bool:
    """Checks whether this is what a browser sends for a file input without a file."""
    return isinstance(value, UploadFile) and not value.filename and not value.size


def _list_others(kind: Kind) -> tuple[str, ...]:
    """Lists the fields other than the file and the options."""
    return (FILE_ID, SCENE, FORMAT) if kind.takes_scenes else (FILE_ID, FORMAT)


def _find_input(upload: UploadFile | None, file_id: str | None, scene: str | None, kind: Kind) -> _Input:
    inputs = {SCENE: scene, FILE_ID: file_id, FILE: upload}
    first, *others = [name for name, value in inputs.items() if value is not None] or [""]
    if others:
        raise InvalidOption(f"{first}: given together with {' and '.join(others)}; send one of them")
    if file_id is not None:
        return _Input("", io.BytesIO(), 0, file_id)
    if scene is not None:
        if scene not in SCENES:
            raise InvalidOption(f"{SCENE}: no {clean_text(scene)[:40]!r} here; give one of {', '.join(SCENES)}")
        return _Input(SCENE_PREFIX + scene, io.BytesIO(), 0)
    if upload is None:
        either = f", or a shipped scene as {SCENE!r}" if kind.takes_scenes else ""
        kept = f", the id of a kept file as {FILE_ID!r}"
        raise InvalidOption(f"{FILE}: missing; send {kind.takes} as the part {FILE!r}{kept}{either}")
    name = make_name(upload.filename or "", takes_light_fields=kind.takes_light_fields)
    return _Input(name, upload.file, upload.size or 0)


def make_name(given: str, *, takes_light_fields: bool) -> str:
    """Makes the name of the input: `upload` and the parts of the given name that are used.

    These are the suffix and, for a light field, the part that marks a quilt or ESLF. Raises `InvalidOption` if the
    layout of a quilt is out of range.
    """
    path = PurePosixPath(given.replace("\\", "/"))
    suffix = path.suffix.lower()
    if re.fullmatch(r"\.[a-z0-9]{1,8}", suffix) is None:
        return "upload"
    if not ((is_picture(path.name) or is_container(path.name)) and takes_light_fields):
        return f"upload{suffix}"
    layout = parse_name(path.name)
    eslf = "_eslf" if suffix == ".png" and is_eslf(path.name) else ""
    return f"upload{layout.suffix if layout else ''}{eslf}{suffix}"
