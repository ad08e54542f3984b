"""Colour profiles of picture files (ICC.1:2022), which readers leave out: pixels are taken as sRGB."""

from __future__ import annotations

import re
import struct
from importlib import import_module

from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.picture_sizes import find_format

_SRGB = re.compile(r"srgb|sgr[ae]y|\Ac2(ci)?\Z", re.IGNORECASE)
"""In the names of profiles that are sRGB, or grey with its curve: c2 is a small one that web sites use."""
_LINEAR = re.compile(r"linear|g10", re.IGNORECASE)
_MAX_TAGS = 100
CORRUPT = "corrupt"
"""In place of the name of a profile that can't be read."""


def note_profile(data: bytes, what: str) -> tuple[str, ...]:
    """A note that `what`, the picture in `data`, has a profile that is not sRGB; none where it has no such profile."""
    profile = name_profile(data)
    return () if profile is None else (describe_profile(profile, what),)


def describe_profile(profile: str, what: str) -> str:
    """The note on a profile of that name in `what`."""
    return f"{what}: the colour profile ({profile}) is not sRGB and is left out; convert to sRGB first to keep colours"


def name_profile(data: bytes) -> str | None:
    """The name of the colour profile in a picture file, `CORRUPT` where it can't be read; None where there is none, or
    where it is sRGB.
    """
    entry = find_format(data)
    if entry is None:
        return None
    reader = import_module(f"ciir.renderer.{entry.folder}.{entry.reader.partition(':')[0]}")
    try:
        profile = reader.find_profile(data) if hasattr(reader, "find_profile") else None
        name = None if profile is None else clean_text(_read_name(profile))
    except Exception:  # noqa: BLE001 - what is corrupt raises many kinds
        return CORRUPT
    return None if name is None or (_SRGB.search(name) and not _LINEAR.search(name)) else name


def _read_name(profile: bytes) -> str:
    """The tag `desc` (10.13 and 10.24 of version 2): one text, or the first of several languages."""
    (count,) = struct.unpack_from(">I", profile, 128)
    for entry in range(min(count, _MAX_TAGS)):
        kind, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * entry)
        if kind != b"desc":
            continue
        tag = profile[offset : offset + size]
        if tag[:4] == b"mluc":
            length, start = struct.unpack_from(">II", tag, 20)
            text = tag[start : start + length].decode("utf-16-be")
        else:
            (length,) = struct.unpack_from(">I", tag, 8)
            text = tag[12 : 12 + length].decode("latin-1")
        return text.strip("\0 ") or "without a name"
    return "without a name"
