"""Parts of a file that a request asks for by `Range` (RFC 9110, section 14), to continue a download or show a video."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

_RANGE = re.compile(r"bytes=[ \t]*(\d{0,15})-(\d{0,15})[ \t]*", re.IGNORECASE)


def find_part(headers: Mapping[str, str], tag: str, size: int) -> range | None:
    """Finds which bytes of a file of `size` bytes with the ETag `tag` a request asks for; None for all of them.

    An empty range: those that it asks for don't exist. A `Range` of several parts, one that can't be read, and one with
    an `If-Range` that doesn't name `tag`, strong, stand for the whole file, as the standard allows or demands.
    """
    found = _RANGE.fullmatch(headers.get("range", ""))
    if found is None or headers.get("if-range", tag) != tag or ("if-range" in headers and tag.startswith("W/")):
        return None
    first, last = found.groups()
    if first:
        if last and int(last) < int(first):
            return None
        return range(int(first), min(size, int(last) + 1) if last else size)
    return range(max(0, size - int(last)), size) if last else None


def describe_part(part: range, size: int) -> str:
    """Returns the `Content-Range` of a part, or of the whole file if the part is empty."""
    return f"bytes {part.start}-{part.stop - 1}/{size}" if part else f"bytes */{size}"
