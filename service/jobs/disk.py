"""The disk of the service's folders: checks whether it has room for another upload."""

from __future__ import annotations

import errno
import os
from typing import TYPE_CHECKING

from ciir.service.jobs.resource import DISK_FULL, Resource

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

LEAST_ROOM = 2**18
"""Free bytes that SQLite needs to open its file."""
_GONE = "the server's folder was removed or replaced while the server runs; its operator must start the server again"
_READ_ONLY = "the server's disk can't be written; its operator must make it writable"


def has_room(folder: Path) -> bool:
    """Checks whether the file system of `folder` has `LEAST_ROOM`."""
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize >= LEAST_ROOM


class Disk:
    """The file systems that hold `folders`."""

    def __init__(self, folders: Sequence[Path], database: Path | None, room: int) -> None:
        """`database`: the queue's file, which must stay the same. `room`: bytes that must be free for an upload."""
        self._folders, self._room = folders, room
        self._opened = {} if database is None else {database: database.stat()}
        cause, remedy = DISK_FULL.split("; ")
        self._full = f"{cause} (less than {room:,} bytes left, the largest upload); {remedy}"
        self._state = Resource("the disk", lambda error: error.strerror if isinstance(error, OSError) else None)

    def check(self) -> None:
        """Raises `NoRoom` if a folder has no room, `QueueUnavailable` if it or the database is gone or read-only."""
        with self._state.use():
            try:
                found = [os.statvfs(folder) for folder in self._folders]
                is_same = all(os.path.samestat(opened, path.stat()) for path, opened in self._opened.items())
            except FileNotFoundError:
                is_same = False
            if not is_same:
                raise OSError(errno.ESTALE, _GONE)
            if any(each.f_flag & os.ST_RDONLY for each in found):
                raise OSError(errno.EROFS, _READ_ONLY)
            if any(each.f_bavail * each.f_frsize < self._room or each.f_files > each.f_favail == 0 for each in found):
                raise OSError(errno.ENOSPC, self._full)
