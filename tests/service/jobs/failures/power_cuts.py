"""Power cuts, played: what a disk may hold if the power fails after each step of a recorded process.

`power_cut.c` records the steps of a process. Bytes are on the disk once their file was synced, a name once its folder
was. Of what was not synced, a power cut may spare any part; two extremes are played after each step: no unsynced name
is on the disk, or all are. Unsynced bytes never are, so that a file whose name alone was spared is empty.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, NamedTuple

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

SOURCE = Path(__file__).with_name("power_cut.c")


def record(folder: Path, *argv: str) -> Path:
    """Runs Python with `argv`, whose files are below `folder / "disk"`; returns the record of its steps."""
    compiler = shutil.which("gcc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("gcc, which builds the recorder of power cuts, is not installed here")
    library, log, root = folder / "power_cut.so", folder / "steps", folder / "disk"
    root.mkdir()
    command = [compiler, "-O1", "-Wall", "-Werror", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl", "-lpthread"]
    subprocess.run(command, check=True)  # noqa: S603 - our own
    environment = os.environ | {"LD_PRELOAD": str(library), "POWER_CUT_ROOT": str(root), "POWER_CUT_LOG": str(log)}
    done = subprocess.run([sys.executable, *argv], env=environment, check=False, capture_output=True, text=True)  # noqa: S603
    assert done.returncode == 0, done.stderr
    return log


def mark(*words: str) -> None:
    """Called in the recorded process: notes what a client knows from now on."""
    text = " ".join(words).encode()
    with Path(os.environ["POWER_CUT_LOG"]).open("ab", buffering=0) as log:
        log.write(b"M 0 %d \t\n%s" % (len(text), text))


class Cut(NamedTuple):
    """A power cut."""

    marks: tuple[str, ...]
    """What clients knew."""
    files: dict[str, bytes | None]
    """What the disk holds: content by path relative to the root; None for a folder."""

    def write(self, folder: Path) -> None:
        """Creates the files in `folder`."""
        for name, content in sorted(self.files.items()):
            path = folder / name
            if content is None:
                path.mkdir()
            else:
                path.write_bytes(content)


@dataclass(eq=False)
class _Node:
    """A file or a folder."""

    is_folder: bool
    synced: bytes = b""


@dataclass
class _Disk:
    root: PurePath
    nodes: dict[int, _Node] = field(default_factory=dict)
    """By inode."""
    live: dict[PurePath, _Node] = field(default_factory=dict)
    synced: dict[PurePath, _Node] = field(default_factory=dict)
    """Names in folders that were synced since."""

    def play(self, kind: str, inode: int, first: PurePath, second: PurePath, data: bytes) -> None:
        if kind in "CD":
            self.live[first] = _Node(kind == "D")
            if kind == "C":
                self.nodes[inode] = self.live[first]
        elif kind == "S":
            self.nodes.setdefault(inode, _Node(is_folder=False)).synced = data
        elif kind == "F":
            self.synced = {name: node for name, node in self.synced.items() if name.parent != first}
            self.synced |= {name: node for name, node in self.live.items() if name.parent == first}
        elif kind == "R":
            self.live.pop(first, None)
            self.live[second] = self.nodes.setdefault(inode, _Node(is_folder=False))
        elif kind == "U":
            self.live.pop(first, None)

    def list_cuts(self, marks: tuple[str, ...]) -> Iterator[Cut]:
        for names in (self.synced, self.live):
            reachable = {self.root}
            files: dict[str, bytes | None] = {}
            for path, node in sorted(names.items()):
                if path.parent in reachable and not path.name.endswith("-shm"):  # SQLite's memory, never synced
                    if node.is_folder:
                        reachable.add(path)
                    files[str(path.relative_to(self.root))] = None if node.is_folder else node.synced
            yield Cut(marks, files)


def list_cuts(log: Path) -> list[Cut]:
    """The different power cuts after each step of a record."""
    disk = _Disk(log.with_name("disk"))
    marks: tuple[str, ...] = ()
    found: dict[object, Cut] = {}
    with log.open("rb") as file:
        while line := file.readline():
            kind, inode, size, paths = line.rstrip(b"\n").decode().split(" ", 3)
            data = file.read(int(size))
            if kind == "M":
                marks = (*marks, data.decode())
            else:
                first, second = (PurePath(path) for path in paths.split("\t"))
                disk.play(kind, int(inode), first, second, data)
            for cut in disk.list_cuts(marks):
                found[marks, frozenset((path, id(content)) for path, content in cut.files.items())] = cut
    return list(found.values())
