"""An audit hook that notes every file, connection and program that is opened while untrusted input is read."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from ciir import models

FORBIDDEN = frozenset(
    {
        "open",
        "os.exec",
        "os.listdir",
        "os.posix_spawn",
        "os.remove",
        "os.rename",
        "os.scandir",
        "os.symlink",
        "os.system",
        "pickle.find_class",
        "shutil.copyfile",
        "socket.bind",
        "socket.connect",
        "socket.getaddrinfo",
        "socket.gethostbyname",
        "subprocess.Popen",
        "urllib.Request",
        "webbrowser.open",
    }
)
"""Python's audit events that reading bytes has no need of (https://docs.python.org/3/library/audit_events.html)."""


_OURS = ("/proc/", "/sys/", sys.prefix, f"{sys.base_prefix}/lib/python", str(Path(models.__file__).resolve().parent))
"""What is about the machine, installed packages, or the networks that ship: none of it is named by an input."""


_OF_FILES = frozenset({"open", "os.listdir", "os.remove", "os.rename", "os.scandir"})


class Guard:
    """Notes what happens once it is armed, but for files in `folders` and in `_OURS`.

    A hook stays for as long as the process: there is no way to take it out.
    """

    def __init__(self, *folders: Path) -> None:
        self.seen: list[str] = []
        """Each forbidden event, as text."""
        self._allowed = (*_OURS, *(str(folder.resolve()) for folder in folders))
        self._is_armed = False
        sys.addaudithook(self._hook)

    def arm(self) -> None:
        """From now on: modules that are imported late must have been by then."""
        self._is_armed = True

    def disarm(self) -> None:
        """No longer."""
        self._is_armed = False

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self._is_armed and event in FORBIDDEN and not self._is_our_own(event, arguments):
            self.seen.append(f"{event} {arguments!r}"[:300])

    def _is_our_own(self, event: str, arguments: tuple[Any, ...]) -> bool:
        if event not in _OF_FILES or not arguments:
            return False
        if not isinstance(arguments[0], (str, bytes)):
            return isinstance(arguments[0], int)  # a file that is open already
        path = os.path.realpath(os.fsdecode(arguments[0]))
        if event in {"os.listdir", "os.scandir"} and path in {os.path.realpath(place) for place in sys.path}:
            return True  # where `importlib.metadata` looks for packages and their versions
        return path.startswith(self._allowed)
