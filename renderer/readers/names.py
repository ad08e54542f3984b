"""File names of untrusted input: made fit for messages, and resolved to keys of a bundle."""

from __future__ import annotations

import posixpath
import re
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Sequence

TILES = "light_field.json", "coarse.jpg"
"""The first files of what `renderer.writers.containers.tiles` writes, which is not read: its description, a mosaic."""
FRAMES = "white", "dark"
"""What the frames of a raw lenslet picture are named in a folder or a zip."""
_LISTED = 10
"""Most things of a file that a message lists."""
_DRIVE_OR_SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*:")


def clean_text(text: str) -> str:
    """`text` fit for one line of a message: control characters replaced, at most 80 characters."""
    clean = "".join(c if c.isprintable() else "?" for c in text)
    return clean if len(clean) <= 80 else f"{clean[:38]}...{clean[-39:]}"


def is_eslf(name: str) -> bool:
    """Whether the name of a PNG makes it Lytro's ESLF: `..._eslf.png`."""
    return PurePosixPath(name.lower()).stem.endswith("eslf")


def is_hidden(key: str) -> bool:
    """Whether `key` is a hidden file, lies in a hidden folder, or is what macOS adds to a zip."""
    return any(part.startswith((".", "__MACOSX")) for part in key.split("/"))


def resolve_key(name: str, folder: str = "") -> str | None:
    """The normalised key of `name` relative to `folder`, both with `/`; None where it would leave the bundle.

    None for empty names, absolute paths, drive letters and URLs, backslashes, NUL, and any `..` that climbs out.
    """
    if not name or name.startswith("/") or "\\" in name or "\0" in name or _DRIVE_OR_SCHEME.match(name):
        return None
    key = posixpath.normpath(posixpath.join(folder, name))
    return None if key in {".", ".."} or key.startswith("../") else key


def find_numbered(option: str, given: str, titles: Sequence[Sequence[str]], holder: str) -> int:
    """The number of what `given` names: a number from 0, or one of the `titles` of a thing that the file `holder` has.

    Raises `InvalidOption` with a list of what there is.
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
        raise InvalidOption(f"{option}: {clean_text(given)[:40]!r} is none of {holder}'s; give {known}")
    return number
