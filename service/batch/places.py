"""Files by path or by URL (fsspec): the inputs of a batch, and the folder for its outputs."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import tempfile
import uuid
from collections.abc import Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath, PurePosixPath
from typing import TYPE_CHECKING, Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from ciir.errors import Error, InvalidOption, JobError, TooLarge, Unreadable, advise_extra
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.names import clean_text, is_hidden, resolve_key
from ciir.renderer.writers.atomic_write import replacing
from ciir.service.errors import join_lines
from ciir.service.jobs.resource import PROGRAMMING_ERRORS
from ciir.service.pipeline.limits import read_limits
from ciir.service.pipeline.source import SCENE, open_source

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ciir.renderer.limits import Limits
    from ciir.service.pipeline.source import Source

PARTS = "parts"
STATE = ".batch"
"""The folder inside the output folder in which a batch keeps its own files."""


def open_filesystem(text: str) -> tuple[Any, str]:
    """Returns the file system of a path or a URL, and the path in it. Raises `InvalidOption`."""
    try:
        filesystem, path = fsspec.core.url_to_fs(text, use_listings_cache=False)
    except ImportError as error:
        extra = f"; run {advise_extra('s3')}" if text.startswith("s3:") else ""
        raise InvalidOption(f"{text}: the package that reads such URLs is not installed ({error}){extra}") from error
    except ValueError as error:
        raise InvalidOption(f"{text}: no such kind of URL ({error}); give a path, or a URL such as s3://") from error
    except (AttributeError, TypeError) as error:  # raised by file systems to which the URL gives too little
        raise InvalidOption(
            f"{text}: this kind of URL doesn't say all that is needed ({error}); give a path, or a URL such as s3://"
        ) from error
    return filesystem, path.rstrip("/") or path


def locate(text: str) -> str:
    """Returns the absolute path of a local file or folder given by path or URL; any other URL in its usual spelling."""
    filesystem, path = open_filesystem(text)
    return path if isinstance(filesystem, LocalFileSystem) else str(filesystem.unstrip_protocol(path))


def resolve(place: str) -> tuple[PurePath, ...]:
    """Resolves links in the folders of an absolute path, and adds the target if it is a link. A URL stays as is."""
    if "://" in place:
        return (PurePosixPath(place),)
    path = Path(os.path.realpath(Path(place).parent), Path(place).name)
    return (path, Path(os.path.realpath(path))) if path.is_symlink() else (path,)


@contextmanager
def reach_store(text: str, filesystem: Any) -> Iterator[None]:
    """Raises `InvalidOption` instead of an error of the client of the store at the URL `text`.

    Each client has its own errors, such as botocore's if there are no credentials. Errors of local files and
    programming errors are raised as they are.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, (Error, *PROGRAMMING_ERRORS)) or isinstance(filesystem, LocalFileSystem):
            raise
        raise InvalidOption(
            f"{text}: can't be reached ({join_lines(str(error) or type(error).__name__)}); check the address, and the "
            "variables with its credentials"
        ) from error


def open_place(text: str) -> Source:
    """Opens the input at a path or a URL, or `scene:NAME`, within the limits of the environment.

    Raises `InputError`.
    """
    if text.startswith(SCENE) or "://" not in text:
        return open_source(text)
    filesystem, path = open_filesystem(text)
    limits = read_limits()
    try:
        if filesystem.isdir(path):
            return Bundle(PurePosixPath(path).name, None, RemoteFolder(filesystem, path, limits), limits)
        name, data = PurePosixPath(path).name, read_remote(filesystem, path, limits)
    except FileNotFoundError as error:
        raise Unreadable(f"{text}: there is no such file; check the name") from error
    found = Bundle.from_upload(name, data, limits)
    if found.main is None:
        return found
    beside = RemoteFolder(filesystem, str(PurePosixPath(path).parent), limits, {found.main: data})
    return Bundle(name, found.main, beside, limits)


def read_remote(filesystem: Any, path: str, limits: Limits) -> bytes:
    """Returns the bytes of a file. Raises `TooLarge` over the limit."""
    size = filesystem.size(path)
    if size is not None and size > limits.bytes:
        raise TooLarge(f"{clean_text(path)}: {size:,} bytes; at most {limits.bytes:,} are read", "bytes")
    data: bytes = filesystem.cat_file(path)
    return data


class RemoteFolder(Mapping[str, bytes]):
    """The files below a folder in a store, read when first used. Hidden files are not listed.

    Raises `TooLarge` when iterating over more than `limits.files` files, and for a file of more than `limits.bytes`.
    """

    def __init__(self, filesystem: Any, path: str, limits: Limits, known: Mapping[str, bytes] | None = None) -> None:
        self._filesystem, self._path, self._limits = filesystem, path, limits
        self._known = known or {}

    def __getitem__(self, key: str) -> bytes:
        if key in self._known:
            return self._known[key]
        if resolve_key(key) != key:
            raise KeyError(key)
        try:
            return read_remote(self._filesystem, f"{self._path}/{key}", self._limits)
        except FileNotFoundError as error:
            raise KeyError(key) from error

    def __contains__(self, key: object) -> bool:
        if key in self._known:
            return True
        return isinstance(key, str) and resolve_key(key) == key and self._filesystem.isfile(f"{self._path}/{key}")

    def __iter__(self) -> Iterator[str]:
        found = (str(path).removeprefix(self._path).lstrip("/") for path in self._filesystem.find(self._path))
        keys = sorted(key for key in found if not is_hidden(key))
        if len(keys) > self._limits.files:
            raise TooLarge(
                f"{clean_text(self._path)}: more than {self._limits.files:,} files; give a folder that holds fewer",
                "files",
            )
        yield from keys

    def __len__(self) -> int:
        return sum(1 for _ in self)


class Outputs:
    """The folder for a batch's outputs. Names in it are relative, with `/`. Files appear in it only when complete."""

    def __init__(self, text: str) -> None:
        """`text`: a path or a URL. Raises `InvalidOption` if it can't be used."""
        self._filesystem, self._root = open_filesystem(text)
        self._is_local = isinstance(self._filesystem, LocalFileSystem)
        if self._is_local and Path(self._root).exists() and not Path(self._root).is_dir():
            raise InvalidOption(f"{text}: a file is there; name a folder for the outputs")
        with reach_store(text, self._filesystem):  # fails before any work, which begins with reading a record
            self.read(f"{STATE}/records/none")

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"

    @contextmanager
    def open_scratch(self) -> Iterator[Path]:
        """Provides a separate local folder for an unfinished result.

        It is on the same file system as the outputs if they are local.
        """
        if not self._is_local:
            with (
                _explain_full_disk(tempfile.gettempdir()),
                tempfile.TemporaryDirectory(prefix="ciir-batch-") as temporary,
            ):
                yield Path(temporary)
            return
        folder = Path(self._path(f"{STATE}/scratch/{uuid.uuid4().hex}"))
        try:
            with _explain_full_disk(self._root):
                folder.mkdir(parents=True)
                yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keeps other batches out of a local folder. At the end, removes what killed workers left there.

        Raises `InvalidOption` if another batch is running.
        """
        if not self._is_local:
            yield
            return
        state = Path(self._path(STATE))
        state.mkdir(parents=True, exist_ok=True)
        with (state / "lock").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise InvalidOption(
                    f"{self._root}: another batch writes there; wait for its end, or name another folder"
                ) from error
            try:
                yield
            finally:
                shutil.rmtree(state / "scratch", ignore_errors=True)
                with suppress(OSError):  # there are none, or some belong to an unfinished input
                    (state / PARTS).rmdir()

    def measure(self, name: str) -> int | None:
        """Returns the size of a file in bytes, or None if it does not exist."""
        try:
            size: int = self._filesystem.size(self._path(name))
        except (FileNotFoundError, NotADirectoryError):
            return None
        return size

    def read(self, name: str) -> bytes | None:
        """Returns the bytes of a file, or None if it does not exist."""
        try:
            data: bytes = self._filesystem.cat_file(self._path(name))
        except FileNotFoundError:
            return None
        return data

    def write(self, name: str, data: bytes) -> None:
        """Writes a file."""
        if not self._is_local:
            self._filesystem.pipe_file(self._path(name), data)
            return
        with _explain_full_disk(self._root), replacing(Path(self._path(name))) as file:
            file.write(data)

    def move(self, local: Path, name: str) -> dict[str, int]:
        """Moves a finished local file, or the files of a folder, to `name`.

        Returns the names and sizes of all of them.
        """
        names = {name: local}
        if local.is_dir():
            names = {f"{name}/{file.name}": file for file in sorted(local.iterdir())}
        sizes = {target: source.stat().st_size for target, source in names.items()}
        for target, source in names.items():
            if self._is_local:
                place = Path(self._path(target))
                place.parent.mkdir(parents=True, exist_ok=True)
                source.replace(place)
            else:
                self._filesystem.put_file(str(source), self._path(target))
        return sizes

    def fetch(self, name: str, local: Path) -> Path:
        """Returns a local path of the file: its own, or that of a copy at `local`."""
        if self._is_local:
            return Path(self._path(name))
        self._filesystem.get_file(self._path(name), str(local))
        return local

    def remove(self, names: Iterable[str]) -> None:
        """Removes the files that exist."""
        for name in names:
            with suppress(FileNotFoundError):
                self._filesystem.rm_file(self._path(name))

    def remove_empty_folder(self, name: str) -> None:
        """Removes a local folder if it is empty; a store has no empty folders."""
        if self._is_local:
            with suppress(OSError):  # it is a file, does not exist, or is not empty
                Path(self._path(name)).rmdir()

    def remove_folder(self, name: str) -> None:
        """Removes a folder, if it exists."""
        if self._filesystem.exists(self._path(name)):
            self._filesystem.rm(self._path(name), recursive=True)


@contextmanager
def _explain_full_disk(place: str) -> Iterator[None]:
    """Raises `JobError` if the disk of `place` is full, because the system's error does not name the place."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise JobError(f"{place}: {error.strerror}; make room there, and run the batch again") from error
