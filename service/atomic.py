"""Files and folders that appear whole or not at all: written beside their place under another name, then moved."""

from __future__ import annotations

import shutil
import uuid
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING

from renderer.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def partial(path: Path) -> Path:
    """A name for `path` while it isn't finished: hidden, unique, and on the same file system. Makes its folder."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise InvalidOption(f"{path.parent}: not a folder; name another place for the output") from error
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.partial")


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """A binary file that takes `path`'s place when the block ends, and is gone when the block raises."""
    if path.is_dir():
        raise InvalidOption(f"{path}: a folder is there; name a file for the output")
    temporary = partial(path)
    try:
        with temporary.open("xb") as file:
            yield file
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


class Staged:
    """A folder in the making. `commit` moves it to `path`: files of the same name there are replaced, others stay."""

    def __init__(self, path: Path) -> None:
        if path.exists() and not path.is_dir():
            raise InvalidOption(f"{path}: a file is there; name a folder for the output, or remove it")
        self.path = path
        self.temporary = partial(path)
        self.temporary.mkdir()

    def write(self, name: str, data: bytes) -> None:
        """Writes a file of the folder."""
        (self.temporary / name).write_bytes(data)

    def commit(self) -> None:
        """Moves everything into place."""
        if not self.path.exists():
            self.temporary.rename(self.path)
            return
        names = sorted(file.name for file in self.temporary.iterdir())
        for name in names:  # all of these are looked at first, so that a fault is found before anything is replaced
            if (self.path / name).is_dir():
                raise InvalidOption(f"{self.path / name}: a folder is there; remove it, or name another output")
        for name in names:
            (self.temporary / name).replace(self.path / name)

    def discard(self) -> None:
        """Removes what was not committed; does nothing after `commit`."""
        shutil.rmtree(self.temporary, ignore_errors=True)
