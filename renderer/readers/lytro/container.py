r"""The sections of Lytro's containers, `.lfp` (F01) and `.lfr` (Illum).

Each section begins with `\x89LF`, one of P, M and C, `\r\n\x1a\n`, a version in 4 bytes and its size in 4, big-endian.
If the size isn't 0, its name `sha1-...` in 45 bytes, 35 zeros and the data follow, then zeros up to the next section. M
is the table of contents: JSON that refers to sections C by their names (LFReadLFP.m of the Light Field Toolbox 0.5, and
imageio's plugin `lytro`).

imageio is not used, because it expects 3 sections in a `.lfp`, whose table is followed by 5 zeros, and 11 in a `.lfr`,
trusts sizes, and takes 600 MB to unpack a picture of 52 MB.
"""

from __future__ import annotations

import json
import struct
from typing import Any

from ciir.errors import Unreadable, UnsupportedType

SIGNATURE = b"\x89LFP\r\n\x1a\n"
_START = b"\x89LF"
_HEAD, _NAME = 16, 80
_MOST_JSON = 1 << 20
_MOST_SECTIONS = 256


def read_frame(data: bytes, name: str) -> tuple[memoryview, dict[str, Any]]:
    """Returns the first frame's packed pixels, and its metadata. Raises `Unreadable`, and `UnsupportedType` if there is
    no raw frame.
    """
    table, sections = _find_sections(data, name)
    picture = table.get("picture")
    frames = picture.get("frameArray") if isinstance(picture, dict) else table.get("frames")
    frame = frames[0].get("frame") if isinstance(frames, list) and frames and isinstance(frames[0], dict) else None
    refs = [frame.get(key) if isinstance(frame, dict) else None for key in ("imageRef", "metadataRef")]
    if not all(isinstance(ref, str) for ref in refs):
        raise UnsupportedType(f"{name}: holds no raw picture, only one processed by Lytro's software; give the raw one")
    if not all(ref in sections for ref in refs):
        raise Unreadable(f"{name}: the raw picture or its metadata is missing; give the whole file")
    image, metadata = (sections[str(ref)] for ref in refs)
    return image, _parse_json(metadata, name)


def _find_sections(data: bytes, name: str) -> tuple[dict[str, Any], dict[str, memoryview]]:
    view, at = memoryview(data), _HEAD
    table: dict[str, Any] | None = None
    sections: dict[str, memoryview] = {}
    for _ in range(_MOST_SECTIONS):
        at = data.find(_START, at)
        if at < 0 or at + _HEAD > len(data):
            break
        (size,) = struct.unpack_from(">I", data, at + 12)
        start = at + _HEAD + (_NAME if size else 0)
        if start + size > len(data):
            raise Unreadable(f"{name}: a section of {size:,} bytes is cut off; give the whole file")
        if data[at + 3 : at + 4] == b"M":
            table = _parse_json(view[start : start + size], name)
        elif size:
            sections[data[at + _HEAD : at + _HEAD + 45].decode("latin-1")] = view[start : start + size]
        at = start + size
    if table is None:
        raise Unreadable(f"{name}: its table of contents is missing; give the whole file")
    return table, sections


def _parse_json(section: memoryview, name: str) -> dict[str, Any]:
    try:
        parsed = json.loads(bytes(section)) if len(section) <= _MOST_JSON else None
    except (ValueError, RecursionError):
        parsed = None
    if not isinstance(parsed, dict):
        raise Unreadable(f"{name}: a section is not a JSON object of at most {_MOST_JSON:,} bytes; give the file again")
    return parsed
