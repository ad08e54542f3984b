"""Reads the names of colour profiles in pictures (ICC.1:2022). Readers ignore profiles: pixels are taken as sRGB."""

from __future__ import annotations

import re
import struct
from importlib import import_module

from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.picture_sizes import find_format

_SRGB = re.compile(r"srgb|sgr[ae]y|\Ac2(ci)?\Z", re.IGNORECASE)
"""A part of the names of profiles that are sRGB, or grey with its curve; c2 is a small one that web sites use."""
_LINEAR = re.compile(r"linear|g10", re.IGNORECASE)
_MAX_TAGS = 100
CORRUPT = "corrupt"
"""The name of a profile that can't be read."""


def note_profile(data: bytes, what: str) -> tuple[str, ...]:
    """Returns a note if `what`, the picture in `data`, has a profile that is not sRGB."""
    profile = name_profile(data)
    return () if profile is None else (describe_profile(profile, what),)


def describe_profile(profile: str, what: str) -> str:
    """Returns the note on a profile of that name in `what`."""
    return f"{what}: the colour profile ({profile}) is not sRGB and is left out; convert to sRGB first to keep colours"


def name_profile(data: bytes) -> str | None:
    """Returns the name of the colour profile in a picture file, or `CORRUPT` if it can't be read. Returns None if there
    is no profile or if it is sRGB.
    """
    entry = find_format(data)
    if entry is None:
        return None
    reader = import_module(f"ciir.renderer.{entry.folder}.{entry.reader.partition(':')[0]}")
    try:
        profile = reader.find_profile(data) if hasattr(reader, "find_profile") else None
        name = None if profile is None else clean_text(_read_name(profile))
    except Exception:  # noqa: BLE001 - corrupt files raise many kinds
        return CORRUPT
    return None if name is None or (_SRGB.search(name) and not _LINEAR.search(name)) else name


def _read_name(profile: bytes) -> str:
    """Reads the tag `desc` (10.13 and 10.24 of version 2): one text, or the first of several languages."""
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
