"""Inputs and results: files in a folder, or in an object store through fsspec.

Writes are atomic. In a folder they are on the disk when a method returns; an object store must guarantee that itself.
Worker processes read and write the files in a folder in place; for an object store they use local copies.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO

import fsspec
from fsspec.implementations.local import LocalFileSystem

from ciir.errors import InvalidOption, QueueUnavailable
from ciir.service.jobs.resource import DISK_FULL, FULL_AT_START, PROGRAMMING_ERRORS, Resource, is_full

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

INPUTS, RESULTS, RUNS = "inputs", "results", "runs"
RECORD = ".json"
"""Suffix of the record of an accepted job, which is kept next to the input in case the queue's database is lost."""
CHUNK = 1 << 20
HASHES = 2048
"""Number of files whose hash is kept in memory, at 1 KB each."""
_PARTIAL = ".partial"
_UNUSABLE, _NO_ANSWER = "the server's files can't be used ({}); try again later", "their store doesn't answer"


def hash_content(file: IO[bytes]) -> str:
    """Returns the SHA-256 of all of `file` in hexadecimal digits, and leaves the file at its beginning."""
    digest = hashlib.sha256()
    file.seek(0)
    while chunk := file.read(CHUNK):
        digest.update(chunk)
    file.seek(0)
    return digest.hexdigest()


def make_folder(folder: Path, mode: int = 0o777) -> None:
    """Creates the folder and its missing parents, and waits until they are on the disk."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(mode=mode, parents=True, exist_ok=True)
    for path in new:
        _sync(path.parent)


def _sync(path: str | Path) -> None:
    """Waits until a file, or the names in a folder, are on the disk."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


@dataclass(frozen=True)
class RunFiles:
    """The local files of one run."""

    source: Path
    target: Path
    """In its own folder, which is removed when the run ends."""
    publish: Callable[[], tuple[int, str]]
    """Moves `target` to the results, and returns its size in bytes and its SHA-256. Raises `QueueUnavailable`."""


class Files:
    """Files by name in `INPUTS` and `RESULTS`. Every method raises `QueueUnavailable` if they can't be used."""

    def __init__(self, place: str, scratch: Path) -> None:
        """`place`: a folder, which is created, or a URL such as s3://BUCKET/PATH. `scratch`: a folder for local copies.

        Raises `InvalidOption` if the place can't be used.
        """
        self._place = Resource("the files", self._describe)
        self._writes = Resource("writing files", lambda error: self._describe(error, is_write=True))
        self._probing = threading.Lock()
        self._hash = lru_cache(HASHES)(self._hash_file)
        try:
            self._fs, root = fsspec.core.url_to_fs(place, use_listings_cache=False)  # other servers write there too
            self._is_local = isinstance(self._fs, LocalFileSystem)
            self._root = root.rstrip("/")
            self.runs = (Path(self._root) if self._is_local else scratch) / RUNS
            """The local folder for the files of runs."""
            make_folder(self.runs)
            for folder in (INPUTS, RESULTS):
                if self._is_local:
                    make_folder(Path(self._path(folder)))
                else:
                    self._fs.makedirs(self._path(folder), exist_ok=True)
            self._probe()
        except PROGRAMMING_ERRORS:
            raise
        except Exception as error:  # each store's client has its own errors
            if is_full(error):
                raise InvalidOption(f"{place}: {FULL_AT_START}") from error
            reason = str(error) or type(error).__name__
            raise InvalidOption(f"{place}: files can't be stored there ({reason}); name another place") from error

    def _probe(self) -> None:
        """Writes an empty file into each folder and removes it. If one is left behind, it is removed as an orphan."""
        for folder in (INPUTS, RESULTS):
            path = self._path(folder, f"probe.{secrets.token_hex(8)}")
            with self._fs.open(path, "wb"):
                pass
            self._fs.rm_file(path)

    def check(self) -> None:
        """Tries an object store again whose last use failed. Folders are checked by `Disk`."""
        failed = [each for each in (self._place, self._writes) if each.has_failed() and not self._is_local]
        if not failed:
            return
        if not self._probing.acquire(blocking=False):  # one call at a time, because a store may take long to fail
            raise QueueUnavailable(_UNUSABLE.format(_NO_ANSWER))
        try:
            for each in failed:
                with each.use():
                    self._probe()
        finally:
            self._probing.release()

    def _path(self, *names: str) -> str:
        return "/".join((self._root, *names))

    def put(self, folder: str, files: Mapping[str, BinaryIO]) -> None:
        """Writes all of each file, from its beginning, under its name."""
        with self._writes.use():
            for name, file in files.items():
                file.seek(0)
                if self._is_local:
                    self._put_locally(self._path(folder, name), name, file)
                else:
                    with self._fs.open(self._path(folder, name), "wb") as out:
                        shutil.copyfileobj(file, out, CHUNK)
            if self._is_local:
                _sync(self._path(folder))

    def _put_locally(self, path: str, name: str, file: BinaryIO) -> None:
        partial = self.runs / f"{name}{_PARTIAL}"
        try:
            with partial.open("xb") as out:
                shutil.copyfileobj(file, out, CHUNK)
                out.flush()
                os.fsync(out.fileno())
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)

    def open(self, folder: str, name: str) -> BinaryIO:
        """Opens the file for reading. Raises `FileNotFoundError`."""
        with self._place.use():
            opened: BinaryIO = self._fs.open(self._path(folder, name), "rb")
        return opened

    def exists(self, folder: str, name: str) -> bool:
        """Checks whether the file exists."""
        with self._place.use():
            return bool(self._fs.exists(self._path(folder, name)))

    def matches(self, folder: str, name: str, size: int, sha256: str) -> bool:
        """Checks whether the file exists with that size and SHA-256.

        Its bytes are read once, and again if its size, its times or its inode have changed.
        """
        path = self._path(folder, name)
        with suppress(FileNotFoundError), self._place.use():
            info = self._fs.info(path)
            return bool(info["size"] == size) and self._hash(path, str(info)) == sha256
        return False

    def _hash_file(self, path: str, identity: str) -> str:  # noqa: ARG002 - a part of the cache's key
        with self._fs.open(path, "rb") as file:
            return hash_content(file)

    def remove(self, folder: str, *names: str) -> None:
        """Removes the files, and anything left by an interrupted `put`, if they exist."""
        for name in names:
            with suppress(FileNotFoundError), self._place.use():
                (self.runs / f"{name}{_PARTIAL}").unlink(missing_ok=True)
                self._fs.rm_file(self._path(folder, name))

    @contextmanager
    def open_run(self, source: str, result: str, sha256: str = "") -> Iterator[RunFiles]:
        """Provides the local files of a run that makes `result` from the input `source`, and removes them at the end.

        Raises `FileNotFoundError` if there is no such input, or if its SHA-256 is not `sha256`, unless that is empty.
        """
        folder = self.runs / result
        try:
            with self._writes.use():
                folder.mkdir()
            with self._place.use():
                path = Path(self._path(INPUTS, source))
                if not self._is_local:
                    path = folder / "input"
                    self._fs.get_file(self._path(INPUTS, source), str(path))
                with path.open("rb") as file:
                    if sha256 and hash_content(file) != sha256:
                        raise FileNotFoundError(f"{path}: damaged, its SHA-256 is not that of the upload")
            target = folder / "result"
            yield RunFiles(path, target, lambda: self._publish(target, result))
        finally:
            self.remove_run(result)

    def _publish(self, target: Path, result: str) -> tuple[int, str]:
        path = self._path(RESULTS, result)
        with self._writes.use():
            if self._is_local:
                _sync(target)
                target.replace(path)
                _sync(self._path(RESULTS))
                info = self._fs.info(path)
                return int(info["size"]), self._hash(path, str(info))  # kept in memory, for requests to this process
            with target.open("rb") as file:
                found = target.stat().st_size, hash_content(file)
            self._fs.put_file(str(target), path)
            return found

    def remove_run(self, result: str) -> None:
        """Removes the local files of the run that makes `result`, but not the published result."""
        shutil.rmtree(self.runs / result, ignore_errors=True)

    def list_names(self, folder: str) -> list[str]:
        """Lists the names of all files in `folder`."""
        with suppress(FileNotFoundError), self._place.use():  # an object store has no empty folders
            return [str(path).rpartition("/")[2] for path in self._fs.ls(self._path(folder), detail=False)]
        return []

    def get_age(self, folder: str, name: str) -> float:
        """Returns the seconds since the file was written, by the system clock. Raises `FileNotFoundError`."""
        with self._place.use():
            return time.time() - float(self._fs.modified(self._path(folder, name)).timestamp())

    def list_runs(self) -> list[str]:
        """Lists the results that runs on this machine are making, or were making when they died."""
        with self._place.use():
            return [path.name for path in self.runs.iterdir() if path.is_dir()]

    def _describe(self, error: Exception, *, is_write: bool = False) -> str | None:
        """Returns the message for an error of the place, or None for any other error.

        These are any `OSError`, but `FileNotFoundError` only for a missing folder (`is_write`). For an object store
        they are any exception except programming errors, because each store's client has its own.
        """
        if isinstance(error, PROGRAMMING_ERRORS):
            return None
        is_missing = isinstance(error, FileNotFoundError) and not is_write
        if is_missing or (self._is_local and not isinstance(error, OSError)):
            return None
        if is_full(error):
            return DISK_FULL
        return _UNUSABLE.format(getattr(error, "strerror", None) or _NO_ANSWER)
