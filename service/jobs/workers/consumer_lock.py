"""A locked file for each consumer, which shows other consumers on the same machine whether its process is alive."""

from __future__ import annotations

import fcntl
import os
import secrets
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

FOLDER = "consumers"


class ConsumerLock:
    """A new name, and a file with that name that is locked until the process ends.

    The system releases the lock even after a kill. Raises `OSError` if the file can't be created.
    """

    def __init__(self, folder: Path) -> None:
        self.name = secrets.token_hex(8)
        self._folder = folder / FOLDER
        self._folder.mkdir(parents=True, exist_ok=True)
        self._file = os.open(self._folder / self.name, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._file, fcntl.LOCK_EX)

    def is_dead(self, name: str) -> bool:
        """Checks whether that consumer's process has certainly ended. False if it is alive, or on another machine."""
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

    def list_names(self) -> list[str]:
        """Lists all consumers on this machine, dead or alive, whose file exists."""
        return [path.name for path in self._folder.iterdir()]

    def count_others(self) -> int:
        """Counts the other live consumers on this machine."""
        return sum(name != self.name and not self.is_dead(name) for name in self.list_names())

    def remove(self, name: str) -> None:
        """Removes the file of a dead consumer."""
        (self._folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Releases the lock and removes the file."""
        os.close(self._file)
        self.remove(self.name)
