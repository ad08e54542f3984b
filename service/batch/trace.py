"""The content that a task reads from its input: as long as all of it is unchanged, so is the result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ciir.renderer.readers.picture_sizes import read_start
from ciir.service.jobs.identity import hash_installation

if TYPE_CHECKING:
    from ciir.service.pipeline.options import Options

Trace = dict[str, Any]
"""`files`: the SHA-256 of each file that was read; `sizes`: the bytes of each; `looked_for`: whether a file was there;
`names`: the hash of the names of all files, or None if they were not listed.
"""


class TracedFiles(Mapping[str, bytes]):
    """The files of an input, with a record of what was read, looked for and listed. Safe for several threads."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files
        self._read: dict[str, str] = {}
        self._sizes: dict[str, int] = {}
        self._looked_for: dict[str, bool] = {}
        self._names: str | None = None

    def __getitem__(self, key: str) -> bytes:
        try:
            data = self._files[key]
        except KeyError:
            self._looked_for[key] = False
            raise
        if key not in self._read:
            self._read[key], self._sizes[key] = _hash(data), len(data)
        return data

    def read_start(self, key: str, length: int) -> bytes | None:
        """Reads the start of a file like `picture_sizes.StartReader.read_start`.

        It is not recorded, because it only decides whether the input is refused.
        """
        return read_start(self._files, key, length)

    def __contains__(self, key: object) -> bool:
        found = key in self._files
        self._looked_for[str(key)] = found
        return found

    def __iter__(self) -> Iterator[str]:
        names = list(self._files)
        self._names = _hash_names(names)
        return iter(names)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    @property
    def trace(self) -> Trace:
        """What has been read so far."""
        looked_for = {key: found for key, found in self._looked_for.items() if key not in self._read}
        read = {"files": dict(self._read), "sizes": dict(self._sizes)}
        return read | {"looked_for": looked_for, "names": self._names}


def matches(trace: Trace, files: Mapping[str, bytes]) -> bool:
    """Checks whether everything that `trace` records is the same in `files`."""
    if any((key in files) != found for key, found in trace["looked_for"].items()):
        return False
    if trace["names"] is not None and _hash_names(list(files)) != trace["names"]:
        return False
    return all(key in files and _hash(files[key]) == digest for key, digest in trace["files"].items())


def compute_key(*settings: object, options: Options) -> str:
    """Hashes everything except the input's content that a result depends on: settings, options and the installation."""
    given = [hash_installation(), options.as_dict(), *settings]
    return _hash(json.dumps(given, sort_keys=True).encode())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _hash_names(names: list[str]) -> str:
    return _hash("\0".join(sorted(names)).encode())
