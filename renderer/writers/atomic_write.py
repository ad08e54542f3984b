"""Writes files and folders that appear whole or not at all: made next to their place under another name, then moved."""

from __future__ import annotations

import os
import shutil
import stat
import uuid
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator


def read_path(path: Any, option: str = "path") -> Path:
    """Returns the path that a caller gives. Raises `InvalidOption` for an empty name, and for anything that is not a
    name.
    """
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        raise InvalidOption(f"{option}: {repr(path)[:40]} is not a name; give that of a file or a folder")
    return Path(path)


def place_for_file(path: Path) -> Path:
    """Returns `path`, absolute and without links. Raises `InvalidOption` if no file can be put there; creates
    nothing.
    """
    with suppress(FileNotFoundError, NotADirectoryError):  # others may remove the file at any moment, so stat it once
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InvalidOption(f"{path}: a folder is there; name a file for the output")
        if not stat.S_ISREG(mode):  # a device or a pipe, which the finished file would replace
            raise InvalidOption(f"{path}: not a regular file; name another place for the output")
    path = path.resolve()
    _check_folder(path)
    return path


def _check_folder(path: Path) -> None:
    """Raises `InvalidOption` unless `path` can be created, in existing folders or in those made for it."""
    folder = next(parent for parent in path.parents if parent.exists())
    if not folder.is_dir():
        raise InvalidOption(f"{folder}: not a folder; name another place for the output")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InvalidOption(f"{folder}: no permission to write there; name another place for the output")


def _partial(folder: Path, name: str) -> Path:
    """Returns the name of `name` while it isn't finished: hidden, unique, in `folder`, which is created. It has the
    first 50 characters of `name`, at most 200 bytes, because file systems allow 255.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f".{name[:50]}.{uuid.uuid4().hex[:12]}.partial"


@contextmanager
def _naming(path: Path, temporary: Path) -> Iterator[None]:
    """Makes errors of the operating system that name `temporary`, or a file in it, name `path`."""
    try:
        yield
    except OSError as error:
        if str(error.filename).startswith(str(temporary)):
            error.filename = str(path)
        raise


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """Opens a binary file that takes `path`'s place when the block ends, and is removed if the block raises."""
    given, path = path, place_for_file(path)
    temporary = _partial(path.parent, path.name)
    try:
        with _naming(given, temporary):
            with temporary.open("xb") as file:
                yield file
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


class Staged:
    """A folder being written. `commit` moves it to `path`: files of the same name there are replaced, others stay."""

    def __init__(self, path: Path) -> None:
        if path.exists() and not path.is_dir():
            raise InvalidOption(f"{path}: a file is there; name a folder for the output, or remove it")
        self._given = path
        self.path = path.resolve()
        if self.path.is_dir():  # it may be the root of a file system: files outside can't be moved into it
            self.temporary = _partial(self.path, self.path.name)
        else:
            _check_folder(self.path)
            self.temporary = _partial(self.path.parent, self.path.name)
        with _naming(path, self.temporary):
            self.temporary.mkdir()

    def write(self, name: str, data: bytes) -> None:
        """Writes a file in the folder."""
        with _naming(self._given, self.temporary):
            (self.temporary / name).write_bytes(data)

    def commit(self, remove: Collection[str] = ()) -> None:
        """Moves everything into place, and removes the files called `remove` that were not written again."""
        if not self.path.exists():
            with _naming(self._given, self.temporary):
                self.temporary.rename(self.path)
            return
        names = sorted(file.name for file in self.temporary.iterdir())
        for name in names:  # all names are checked before the first is replaced
            if (self.path / name).is_dir():
                raise InvalidOption(f"{self.path / name}: a folder is there; remove it, or name another output")
        for name in names:
            (self.temporary / name).replace(self.path / name)
        for name in set(remove) - set(names):
            (self.path / name).unlink(missing_ok=True)

    def discard(self) -> None:
        """Removes what was not committed; does nothing after `commit`."""
        shutil.rmtree(self.temporary, ignore_errors=True)
