"""The types of files that are written: the base of all registries of formats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True)
class FileType:
    """A type of file."""

    name: str
    """Name of the format."""
    suffixes: tuple[str, ...]
    """Suffixes of file names, in lower case; the first is the usual one."""
    media_type: str

    @property
    def suffix(self) -> str:
        """The usual suffix."""
        return self.suffixes[0]


_Type = TypeVar("_Type", bound=FileType)

BINARY = "application/octet-stream"
"""The media type of formats without one of their own."""


def index_suffixes(types: Iterable[_Type]) -> dict[str, _Type]:
    """Returns the type for each suffix: the first one of several."""
    found: dict[str, _Type] = {}
    for entry in types:
        for suffix in entry.suffixes:
            found.setdefault(suffix, entry)
    return found
