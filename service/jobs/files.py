"""Inputs and results: files in a folder, or in an object store through fsspec. Writes are atomic.

Worker processes read and write the files of a folder in place, and local copies of those of an object store.
"""

from __future__ import annotations

import shutil
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO

import fsspec
from fsspec.implementations.local import LocalFileSystem

from ciir.errors import InvalidOption
from ciir.service.jobs.resource import Resource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

INPUTS, RESULTS, RUNS = "inputs", "results", "runs"
CHUNK = 1 << 20
_PARTIAL = ".partial"


@dataclass(frozen=True)
class RunFiles:
    """The local files of one run."""

    source: Path
    target: Path
    """In a folder of its own, which is removed when the run ends."""
    publish: Callable[[], None]
    """Moves `target` to the results; raises `QueueUnavailable`."""


class Files:
    """Files by name in `INPUTS` and `RESULTS`. Every method raises `QueueUnavailable` if they can't be used."""

    def __init__(self, place: str, scratch: Path) -> None:
        """`place`: a folder, which is created, or a URL such as s3://BUCKET/PATH; `scratch`: a folder for local copies.

        Raises `InvalidOption` if it can't be used.
        """
        self._place = Resource("the files", self._describe)
        try:
            self._fs, root = fsspec.core.url_to_fs(place, use_listings_cache=False)  # other servers write there too
            self._is_local = isinstance(self._fs, LocalFileSystem)
            self._root = root.rstrip("/")
            self._runs = (Path(self._root) if self._is_local else scratch) / RUNS
            self._runs.mkdir(parents=True, exist_ok=True)
            for folder in (INPUTS, RESULTS):
                self._fs.makedirs(self._path(folder), exist_ok=True)
        except (OSError, ImportError, ValueError) as error:
            raise InvalidOption(f"{place}: files can't be stored there ({error}); name another place") from error

    def _path(self, *names: str) -> str:
        return "/".join((self._root, *names))

    def put(self, folder: str, name: str, file: BinaryIO) -> None:
        """Writes all of `file`, from its beginning."""
        with self._place.use():
            file.seek(0)
            if self._is_local:
                self._put_locally(self._path(folder, name), name, file)
            else:
                with self._fs.open(self._path(folder, name), "wb") as out:
                    shutil.copyfileobj(file, out, CHUNK)

    def _put_locally(self, path: str, name: str, file: BinaryIO) -> None:
        partial = self._runs / f"{name}{_PARTIAL}"
        try:
            with partial.open("xb") as out:
                shutil.copyfileobj(file, out, CHUNK)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)

    def open(self, folder: str, name: str) -> IO[bytes]:
        """Opens the file for reading; raises `FileNotFoundError`."""
        with self._place.use():
            opened: IO[bytes] = self._fs.open(self._path(folder, name), "rb")
        return opened

    def exists(self, folder: str, name: str) -> bool:
        """Whether there is such a file."""
        with self._place.use():
            return bool(self._fs.exists(self._path(folder, name)))

    def remove(self, folder: str, name: str) -> None:
        """Removes the file, and what an interrupted `put` left, if there is any."""
        with suppress(FileNotFoundError), self._place.use():
            (self._runs / f"{name}{_PARTIAL}").unlink(missing_ok=True)
            self._fs.rm_file(self._path(folder, name))

    @contextmanager
    def open_run(self, source: str, result: str) -> Iterator[RunFiles]:
        """The local files of a run that makes `result` of the input `source`; removes them at the end.

        Raises `FileNotFoundError` if there is no such input.
        """
        folder = self._runs / result
        try:
            with self._place.use():
                folder.mkdir()
                path = Path(self._path(INPUTS, source))
                if not self._is_local:
                    path = folder / "input"
                    self._fs.get_file(self._path(INPUTS, source), str(path))
                elif not path.exists():
                    raise FileNotFoundError(path)
            target = folder / "result"
            yield RunFiles(path, target, lambda: self._publish(target, result))
        finally:
            self.remove_run(result)

    def _publish(self, target: Path, result: str) -> None:
        with self._place.use():
            if self._is_local:
                target.replace(self._path(RESULTS, result))
            else:
                self._fs.put_file(str(target), self._path(RESULTS, result))

    def remove_run(self, result: str) -> None:
        """Removes the local files of the run that makes `result`, but not the published result."""
        shutil.rmtree(self._runs / result, ignore_errors=True)

    def list_names(self, folder: str) -> list[str]:
        """The names of all files in `folder`."""
        with suppress(FileNotFoundError), self._place.use():  # an object store has no empty folders
            return [str(path).rpartition("/")[2] for path in self._fs.ls(self._path(folder), detail=False)]
        return []

    def get_age(self, folder: str, name: str) -> float:
        """Seconds since the file was written, by the system clock; raises `FileNotFoundError`."""
        with self._place.use():
            return time.time() - float(self._fs.modified(self._path(folder, name)).timestamp())

    def list_runs(self) -> list[str]:
        """The results that runs on this machine are making, or were making when they died."""
        with self._place.use():
            return [path.name for path in self._runs.iterdir() if path.is_dir()]

    def _describe(self, error: Exception) -> str | None:
        """The message for an error of the place: any `OSError` but `FileNotFoundError`, or any exception of an object
        store, as each store's client has its own.
        """
        if isinstance(error, FileNotFoundError) or (self._is_local and not isinstance(error, OSError)):
            return None
        reason = getattr(error, "strerror", None) or "their store doesn't answer"
        return f"the server's files can't be used ({reason}); free disk space, or try again later"
