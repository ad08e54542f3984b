"""The input as names and bytes: one file, a folder or a zip. Files that the input refers to are only looked up here.

Links in a local folder are followed, because the user made or unpacked them. An upload is a file or a zip, and a zip
with links is refused.
"""

from __future__ import annotations

import io
import os
import stat
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import TYPE_CHECKING

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.renderer.readers.names import FRAMES, clean_text, is_hidden, resolve_key
from ciir.renderer.readers.registry import ZIP, identify, is_picture

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


PACKED = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
"""How files in a zip may be packed: zipfile unpacks others whole, however little is read."""


@dataclass(frozen=True)
class Bundle:
    """The files of an input. Keys of `files` are relative, normalised, with `/`."""

    name: str
    """The name in messages and reports."""
    main: str | None
    """The key of the file that was given; None if a set of files was given."""
    files: Mapping[str, bytes]
    limits: Limits = DEFAULT_LIMITS
    """The limits for everything that is read from the files."""
    keep_grid: Callable[[NDArray[np.uint8]], object] | None = None
    """A function that is called with a raw lenslet picture, `(H, W, 3)`, with its lens grid drawn over it."""

    def find_frames(self, key: str) -> dict[str, str]:
        """Finds the pictures named white and dark, by these names, that come with the raw lenslet picture `key`. There
        are none if that picture was given alone.
        """
        beside = [] if self.main is not None else [other for other in self.files if other != key and is_picture(other)]
        stems = {PurePosixPath(other).stem.lower(): other for other in beside}
        return {name: stems[name] for name in FRAMES if name in stems}

    @classmethod
    def from_path(cls, path: Path, limits: Limits = DEFAULT_LIMITS) -> Bundle:
        """Opens the file at `path`, with the files in and below its folder; or a folder; or a zip's contents.

        Files are read when they are first used. Raises `Unreadable` if there is nothing to read, `TooLarge` over a
        limit, and `UnsupportedType` if a file's name and content disagree.
        """
        if path.is_dir():
            return cls(path.resolve().name, None, Folder(path, limits), limits)
        if _is_zip(path):
            return cls(path.name, None, Archive(path, limits), limits)
        data = read_file(path, limits)
        identify(str(path), data)
        return cls(path.name, path.name, Folder(path.parent, limits, {path.name: data}), limits)

    @classmethod
    def from_upload(cls, name: str, data: bytes, limits: Limits = DEFAULT_LIMITS) -> Bundle:
        """Makes a bundle of a client's file alone, or of a zip's contents, unpacked in memory.

        The suffix of `name` is checked against the content; `name` is never used as a path. Raises as `from_path` does.
        """
        own = PurePosixPath(name.replace("\\", "/")).name
        if len(data) > limits.bytes:
            raise TooLarge(_describe_size(own, len(data), limits), "bytes")
        found = identify(own, data)
        if found is ZIP:
            return cls(own, None, unpack(own, data, limits), limits)
        key = resolve_key(own) or f"input.{found.extension}"
        return cls(own, key, {key: data}, limits)


class Folder(Mapping[str, bytes]):
    """The files in and below a folder, read when first used. Hidden files are not listed. Links are followed.

    Iteration raises `TooLarge` if there are more than `limits.files` files or folders, and reading raises it for a file
    of more than `limits.bytes`.
    """

    def __init__(self, path: Path, limits: Limits, known: Mapping[str, bytes] | None = None) -> None:
        self._path = path
        self._limits = limits
        self._known = known or {}  # the file that was given: it may be a link, and is read only once

    def __getitem__(self, key: str) -> bytes:
        if key in self._known:
            return self._known[key]
        path = self._find(key)
        if path is None:
            raise KeyError(key)
        return read_file(path, self._limits)

    def read_start(self, key: str, length: int) -> bytes:
        """Implements `picture_sizes.StartReader.read_start`."""
        path = self._find(key)
        if path is None or key in self._known:
            return self[key][:length]
        with _named_file_errors(path), path.open("rb") as file:
            return file.read(length)

    def __contains__(self, key: object) -> bool:
        return isinstance(key, str) and (key in self._known or self._find(key) is not None)

    def __iter__(self) -> Iterator[str]:
        keys = set(self._known)
        for folder, names in self._walk():
            found = (Path(folder, name) for name in names if not is_hidden(name))
            keys.update(path.relative_to(self._path).as_posix() for path in found if path.is_file())
            self._check_count(len(keys), "files")
        yield from sorted(keys)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _walk(self) -> Iterator[tuple[str, list[str]]]:
        """Yields each folder once, with the names of its files, even if links lead in a circle."""
        seen: set[tuple[int, int]] = set()
        for folder, below, names in os.walk(self._path, followlinks=True):
            status = os.stat(folder)  # noqa: PTH116 - a Path object for each folder is slow
            if (status.st_dev, status.st_ino) in seen:
                below.clear()
                continue
            seen.add((status.st_dev, status.st_ino))
            self._check_count(len(seen), "folders")
            below[:] = [name for name in below if not is_hidden(name)]
            yield folder, names

    def _check_count(self, count: int, what: str) -> None:
        if count > self._limits.files:
            raise TooLarge(
                f"{clean_text(self._path.name)}: more than {self._limits.files:,} {what}; "
                "give a folder that holds fewer",
                "files",
            )

    def _find(self, key: str) -> Path | None:
        if resolve_key(key) != key:
            return None
        path = self._path / key
        try:
            return path if path.is_file() else None
        except OSError:  # a name that the file system does not allow
            return None


class Archive(Mapping[str, bytes]):
    """The files of a zip on the disk, each unpacked when it is used. Hidden files and those of macOS are left out.

    Raises the same errors as `unpack`, with two differences: the limit on bytes applies to each file, and errors in the
    content of a file are raised when that file is used.
    """

    def __init__(self, path: Path, limits: Limits) -> None:
        self._name = clean_text(path.name)
        self._lock = Lock()
        with _named_zip_errors(self._name):
            self._zip = zipfile.ZipFile(path)
            self._members = check_members(self._name, self._zip.infolist(), limits)
        for key, member in self._members.items():
            if member.file_size > limits.bytes:
                raise TooLarge(_describe_size(f"{self._name}: {key}", member.file_size, limits), "bytes")

    def __getitem__(self, key: str) -> bytes:
        member = self._members[key]
        with self._lock, _named_zip_errors(self._name):
            return _check_member(self._name, key, self._zip.read(member))

    def read_start(self, key: str, length: int) -> bytes:
        """Implements `picture_sizes.StartReader.read_start`."""
        member = self._members[key]
        with self._lock, _named_zip_errors(self._name), self._zip.open(member) as file:
            return file.read(length)

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)


def _is_zip(path: Path) -> bool:
    """Checks by its first bytes and its name whether the file is a zip of files. False if it can't be read."""
    try:
        with path.open("rb") as file:
            first = file.read(4)
    except (OSError, ValueError):
        return False
    return first.startswith(ZIP.signatures) and identify(str(path), first) is ZIP


def read_file(path: Path, limits: Limits) -> bytes:
    """Returns the bytes of `path`. Raises `Unreadable` or `TooLarge` instead of the system's errors."""
    with _named_file_errors(path):
        size = path.stat().st_size
        if size > limits.bytes:
            raise TooLarge(_describe_size(str(path), size, limits), "bytes")
        if not path.is_file():
            raise Unreadable(f"{clean_text(str(path))}: not a file; give a mesh, a picture, a zip or a folder")
        return path.read_bytes()


@contextmanager
def _named_file_errors(path: Path) -> Iterator[None]:
    """Raises `Unreadable` instead of the system's errors."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        if isinstance(error, (TooLarge, Unreadable)):
            raise
        why = getattr(error, "strerror", None) or str(error)
        missing = isinstance(error, (FileNotFoundError, NotADirectoryError))
        remedy = "check the name and the folder" if missing else "give a file that can be read"
        raise Unreadable(f"{clean_text(str(path))}: {why}; {remedy}") from error


def _describe_size(name: str, size: int, limits: Limits) -> str:
    name = clean_text(name)
    return f"{name}: {size:,} bytes; at most {limits.bytes:,} are read; decimate the mesh or scale pictures down"


def unpack(name: str, data: bytes, limits: Limits) -> dict[str, bytes]:
    """Unpacks a zip in memory. Hidden files and those that macOS adds are left out.

    Raises `Unreadable` for a corrupt or encrypted zip and for names that lead out of it, `UnsupportedType` for links,
    zips inside the zip and rare compressions, and `TooLarge` over a limit. Sizes are checked before unpacking.
    """
    name = clean_text(name)
    with _named_zip_errors(name), zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = check_members(name, archive.infolist(), limits)
        check_sum(name, members.values(), limits)
        return {key: _check_member(name, key, archive.read(member)) for key, member in members.items()}


def check_sum(name: str, members: Iterable[zipfile.ZipInfo], limits: Limits) -> None:
    """Raises `TooLarge` if the files of a zip are too large to be unpacked together."""
    unpacked = sum(member.file_size for member in members)
    if unpacked > limits.bytes:
        raise TooLarge(
            f"{name}: unpacks to {unpacked:,} bytes; at most {limits.bytes:,} are read; pack fewer or smaller files",
            "bytes",
        )


@contextmanager
def _named_zip_errors(name: str) -> Iterator[None]:
    """Raises `Unreadable` instead of zipfile's many errors."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        raise Unreadable(f"{name}: corrupt or truncated zip ({clean_text(str(error))}); pack it again") from error


def _check_member(name: str, key: str, content: bytes) -> bytes:
    """Raises `UnsupportedType` for a zip within a zip."""
    if content.startswith(b"PK\x03\x04"):
        raise UnsupportedType(f"{name}: holds another zip, {clean_text(key)}; pack the files themselves")
    return content


def check_members(name: str, members: list[zipfile.ZipInfo], limits: Limits) -> dict[str, zipfile.ZipInfo]:
    """Returns the files of a zip by their keys. Raises the errors of `unpack` before anything is unpacked."""
    names = {member: member.orig_filename.replace("\\", "/") for member in members}  # as unzip does
    members = [member for member in members if not names[member].endswith("/")]
    if len(members) > limits.files:
        raise TooLarge(f"{name}: {len(members):,} files; at most {limits.files:,} are read; pack fewer", "files")
    unpacked = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    if unpacked > max(2**20, packed * limits.ratio):
        raise TooLarge(f"{name}: unpacks to over {limits.ratio} times its size; give the files unpacked", "ratio")
    found: dict[str, zipfile.ZipInfo] = {}
    for member in members:
        key = resolve_key(names[member])
        what = clean_text(member.orig_filename)
        if key is None:
            raise Unreadable(f"{name}: the name {what} leads out of the zip; pack relative names")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise UnsupportedType(f"{name}: {what} is a link; pack the file itself")
        if member.flag_bits & 0x1:
            raise Unreadable(f"{name}: {what} is encrypted; pack it without a password")
        if member.compress_type not in PACKED:
            raise UnsupportedType(f"{name}: {what} is packed in a rare way; pack it with plain deflate")
        if key in found:
            raise Unreadable(f"{name}: holds {what} twice; pack it once")
        if not is_hidden(key):
            found[key] = member
    return found
