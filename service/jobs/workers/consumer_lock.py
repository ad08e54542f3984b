"""Who runs a job: a name for each consumer, and whether the process behind a name is still there."""

from __future__ import annotations

import fcntl
import os
import secrets
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

OWNERS = "owners"


class ConsumerLock:
    """A new name, and a file in `folder` that is locked while this process lives: the system lets go of it in the
    moment that the process ends, however it does. Raises `OSError` where that can't be made.
    """

    def __init__(self, folder: Path) -> None:
        self.name = secrets.token_hex(8)
        self._folder = folder / OWNERS
        self._folder.mkdir(parents=True, exist_ok=True)
        self._file = os.open(self._folder / self.name, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._file, fcntl.LOCK_EX)

    def is_gone(self, name: str) -> bool:
        """Whether that process has ended, for certain. False where it lives, or is one of another machine."""
        try:
            file = os.open(self._folder / name, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:
            return False
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        finally:
            os.close(file)
        return True

    def names(self) -> list[str]:
        """All that were here, this one among them, until they are forgotten."""
        return [path.name for path in self._folder.iterdir()]

    def forget(self, name: str) -> None:
        """Removes what one that is gone has left."""
        (self._folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Ends it: the name is gone from here on."""
        os.close(self._file)
        self.forget(self.name)
