"""A bounded store of results on disk, by key: a file for each, whole or not there, checked when it is read.

A file holds the length of its head and a SHA-256 of everything (40 bytes), a head of JSON, and the body.
Nothing in it is ever executed. Its time of change is when it was last used: the oldest go where room is needed. Any
number of processes may share a folder; each keeps it within the limit by itself, so that only what several write in the
same moment can be over it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import struct
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

from renderer.errors import InvalidOption
from service.atomic import replacing

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

SUFFIX = ".result"
CHUNK = 1 << 20
MEMORY_BYTES = 8 << 20
"""A body up to this size stays in memory when it is read; a larger one goes through a temporary file."""
ABANDONED_SECONDS = 3600.0
"""A file that is still being written after so long belongs to a process that has died."""
_START = struct.Struct("<Q32s")
_MAX_HEAD = 64 << 20


@dataclass(frozen=True)
class Stored:
    """What was kept: the head, and the body at its beginning in a file that is the caller's to close."""

    head: Mapping[str, Any]
    body: IO[bytes]
    size: int


class Store:
    """Results of at most `limit` bytes together, in `folder`, which is made when the first is kept."""

    def __init__(self, folder: Path, limit: int) -> None:
        self._folder, self._limit = folder, limit

    def get(self, key: str) -> Stored | None:
        """What `put` kept under `key`, a name of letters and digits; None where it isn't there, or is damaged.

        Damaged files are removed. Raises `OSError` where the folder can't be read.
        """
        path = self._path(key)
        try:
            with path.open("rb") as file:
                found = _read(file)
        except FileNotFoundError:
            return None
        if found is None:
            path.unlink(missing_ok=True)
            return None
        with suppress(
            OSError
        ):  # another process has just made room, or the folder is another's: it is a hit all the same
            os.utime(path)
        return found

    def put(self, key: str, head: Mapping[str, Any], body: IO[bytes]) -> bool:
        """Keeps all of `body`, from its beginning, and `head`, which JSON can hold; leaves `body` at its beginning.

        False where that alone is over the limit. Raises `OSError` or `InvalidOption` where it can't be written.
        """
        text = json.dumps(head, ensure_ascii=False).encode()
        size = _START.size + len(text) + body.seek(0, os.SEEK_END)
        if size > self._limit or len(text) > _MAX_HEAD:
            body.seek(0)
            return False
        self._make_room(size)
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        digest = hashlib.sha256(len(text).to_bytes(8, "little") + text)
        with replacing(self._path(key)) as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(_START.pack(len(text), bytes(32)))
            file.write(text)
            for chunk in _chunks(body):
                digest.update(chunk)
                file.write(chunk)
            file.seek(0)
            file.write(_START.pack(len(text), digest.digest()))
        body.seek(0)
        return True

    def _path(self, key: str) -> Path:
        if re.fullmatch(r"[0-9A-Za-z]{1,128}", key) is None:
            raise InvalidOption(f"{key[:40]!r}: no key; give letters and digits")
        return self._folder / f"{key}{SUFFIX}"

    def _make_room(self, size: int) -> None:
        """Removes the longest unused until `size` bytes more are within the limit."""
        found = sorted(_files(self._folder))
        total = sum(length for _, length, _ in found)
        for used, length, path in found:
            is_abandoned = path.suffix != SUFFIX and time.time() - used > ABANDONED_SECONDS
            if is_abandoned or (total + size > self._limit and path.suffix == SUFFIX):
                path.unlink(missing_ok=True)
                total -= length


def _files(folder: Path) -> Iterator[tuple[float, int, Path]]:
    """When each of our files was last used, its bytes, and its path; others' files are left alone."""
    for path in folder.glob(f"*{SUFFIX}*"):
        if path.suffix in (SUFFIX, ".partial"):
            try:
                state = path.stat()
            except FileNotFoundError:  # another process has just removed it
                continue
            yield state.st_mtime, state.st_size, path


def _read(file: IO[bytes]) -> Stored | None:
    """The result in `file`; None where it is damaged."""
    start = file.read(_START.size)
    if len(start) < _START.size:
        return None
    length, expected = _START.unpack(start)
    text = file.read(length) if length <= _MAX_HEAD else b""
    digest = hashlib.sha256(len(text).to_bytes(8, "little") + text)
    body = tempfile.SpooledTemporaryFile(MEMORY_BYTES)  # noqa: SIM115 - the caller closes it
    while chunk := file.read(CHUNK):
        digest.update(chunk)
        body.write(chunk)
    if digest.digest() != expected:
        body.close()
        return None
    size = body.tell()
    body.seek(0)
    return Stored(json.loads(text), body, size)


def _chunks(file: IO[bytes]) -> Iterator[bytes]:
    file.seek(0)
    while chunk := file.read(CHUNK):
        yield chunk
