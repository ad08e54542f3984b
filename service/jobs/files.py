"""Inputs and results: files in a folder, or in an object store through fsspec; whole or not there.

In a folder a file is written under another name and moved, and worker processes read and write it in place. In an
object store a put is atomic, and worker processes work on local copies.
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

from ciir.errors import InvalidOption, QueueUnavailable
from ciir.service.jobs.error_log import Trouble

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

INPUTS, RESULTS, RUNS = "inputs", "results", "runs"
CHUNK = 1 << 20
_PARTIAL = ".partial"


@dataclass(frozen=True)
class Run:
    """The local files of one run."""

    source: Path
    target: Path
    """In a folder of its own, which goes with all that is in it when the run ends."""
    keep: Callable[[], None]
    """Puts what is at `target` among the results; raises `QueueUnavailable`."""


class Files:
    """Files by name in `INPUTS` and `RESULTS`. Every method raises `QueueUnavailable` where they can't be used."""

    def __init__(self, place: str, scratch: Path) -> None:
        """`place`: a folder, which is made, or an address such as s3://BUCKET/PATH; `scratch`: a folder for copies.

        Raises `InvalidOption` where it can't be used.
        """
        self._trouble = Trouble("the files")
        try:
            self._fs, root = fsspec.core.url_to_fs(place, use_listings_cache=False)  # others write there, too
            self._is_local = isinstance(self._fs, LocalFileSystem)
            self._root = root.rstrip("/")
            self._runs = (Path(self._root) if self._is_local else scratch) / RUNS
            self._runs.mkdir(parents=True, exist_ok=True)
            for folder in (INPUTS, RESULTS):
                self._fs.makedirs(self._path(folder), exist_ok=True)
        except (OSError, ImportError, ValueError) as error:
            raise InvalidOption(f"{place}: files can't be kept there ({error}); name another place") from error

    def _path(self, *names: str) -> str:
        return "/".join((self._root, *names))

    def put(self, folder: str, name: str, file: BinaryIO) -> None:
        """Writes all of `file`, from its beginning."""
        with self._told():
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
        """The file at its beginning; raises `FileNotFoundError`."""
        with self._told():
            opened: IO[bytes] = self._fs.open(self._path(folder, name), "rb")
        return opened

    def exists(self, folder: str, name: str) -> bool:
        """Whether it is there."""
        with self._told():
            return bool(self._fs.exists(self._path(folder, name)))

    def remove(self, folder: str, name: str) -> None:
        """Removes it, if it is there."""
        with suppress(FileNotFoundError), self._told():
            (self._runs / f"{name}{_PARTIAL}").unlink(missing_ok=True)
            self._fs.rm_file(self._path(folder, name))

    @contextmanager
    def run(self, given: str, made: str) -> Iterator[Run]:
        """The local files of a run that makes the result `made` of the input `given`; of `made` nothing stays but what
        was kept. Raises `FileNotFoundError` where there is no such input.
        """
        folder = self._runs / made
        try:
            with self._told():
                folder.mkdir()
                source = Path(self._path(INPUTS, given))
                if not self._is_local:
                    source = folder / "input"
                    self._fs.get_file(self._path(INPUTS, given), str(source))
                elif not source.exists():
                    raise FileNotFoundError(source)
            target = folder / "result"
            yield Run(source, target, lambda: self._keep(target, made))
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _keep(self, target: Path, made: str) -> None:
        with self._told():
            if self._is_local:
                target.replace(self._path(RESULTS, made))
            else:
                self._fs.put_file(str(target), self._path(RESULTS, made))

    def discard(self, made: str) -> None:
        """Removes what a run that died has left, and its result."""
        self.discard_run(made)
        self.remove(RESULTS, made)

    def discard_run(self, made: str) -> None:
        """Removes the local files of a run that died, and none of its result."""
        shutil.rmtree(self._runs / made, ignore_errors=True)

    def names(self, folder: str) -> list[str]:
        """All that are there."""
        with suppress(FileNotFoundError), self._told():  # an object store has no empty folders
            return [str(path).rpartition("/")[2] for path in self._fs.ls(self._path(folder), detail=False)]
        return []

    def age(self, folder: str, name: str) -> float:
        """Seconds since it was written, by the clock on the wall; raises `FileNotFoundError`."""
        with self._told():
            return time.time() - float(self._fs.modified(self._path(folder, name)).timestamp())

    def runs(self) -> list[str]:
        """The names of the results that are being made in this place, or that nobody makes any more."""
        with self._told():
            return [path.name for path in self._runs.iterdir() if path.is_dir()]

    @contextmanager
    def _told(self) -> Iterator[None]:
        """`QueueUnavailable` in place of every `OSError` but `FileNotFoundError`, and of what an object store's client
        raises: those have classes of their own, which nobody here knows.
        """
        try:
            yield
        except FileNotFoundError:
            raise
        except Exception as error:
            if self._is_local and not isinstance(error, OSError):
                raise
            self._trouble.begins(str(error))
            why = getattr(error, "strerror", None) or "their store doesn't answer"
            raise QueueUnavailable(
                f"the server's files can't be used ({why}); make room for them, or try again later"
            ) from error
        self._trouble.is_over()
