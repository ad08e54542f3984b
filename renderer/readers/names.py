"""File names from untrusted input: cleaned for messages, and resolved to keys of a bundle."""

from __future__ import annotations

import posixpath
import re
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Sequence

TILES = "light_field.json", "coarse.jpg"
"""The first files that `renderer.writers.containers.tiles` writes, its description and a mosaic. Tiles are not read."""
FRAMES = "white", "dark"
"""The names of the frames of a raw lenslet picture in a folder or a zip."""
_LISTED = 10
"""The most items of a file that a message lists."""
_DRIVE_OR_SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*:")


def clean_text(text: str) -> str:
    """Cleans `text` for one line of a message: replaces control characters, and keeps at most 80 characters."""
    clean = "".join(c if c.isprintable() else "?" for c in text)
    return clean if len(clean) <= 80 else f"{clean[:38]}...{clean[-39:]}"


def is_eslf(name: str) -> bool:
    """Checks whether the name of a PNG is that of Lytro's ESLF: `..._eslf.png`."""
    return PurePosixPath(name.lower()).stem.endswith("eslf")


def is_hidden(key: str) -> bool:
    """Checks whether `key` is a hidden file, is in a hidden folder, or was added to a zip by macOS."""
    return any(part.startswith((".", "__MACOSX")) for part in key.split("/"))


def resolve_key(name: str, folder: str = "") -> str | None:
    """Returns the normalised key of `name` relative to `folder`, both with `/`; None if it would leave the bundle.

    None also for empty names, absolute paths, drive letters and URLs, backslashes, NUL, and any `..` that climbs out.
    """
    if not name or name.startswith("/") or "\\" in name or "\0" in name or _DRIVE_OR_SCHEME.match(name):
        return None
    key = posixpath.normpath(posixpath.join(folder, name))
    return None if key in {".", ".."} or key.startswith("../") else key


def find_numbered(option: str, given: str, titles: Sequence[Sequence[str]], holder: str) -> int:
    """Returns the number of the item that `given` names: a number from 0, or one of the `titles` of `holder`'s items.

    Raises `InvalidOption` with a list of the items if there is no such item. `holder` is the name of the file.
    """
    if not titles:
        raise InvalidOption(f"{option}: {holder} holds no {option}; leave it out")
    numbers = {str(number): number for number in range(len(titles))}
    named = {title: number for number, own in reversed(list(enumerate(titles))) for title in own if title}
    number = numbers.get(given, named.get(given))
    if number is None:
        shown = [clean_text(next(filter(None, own), ""))[:40] for own in titles]
        listed = ", ".join(f"{i} ({title})" if title else str(i) for i, title in enumerate(shown))
        known = listed if len(titles) <= _LISTED else f"0 to {len(titles) - 1}"
        raise InvalidOption(f"{option}: {clean_text(given)[:40]!r} is not in {holder}; give {known}")
    return number
