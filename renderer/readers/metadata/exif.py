"""Reads the orientation from Exif blocks."""

from __future__ import annotations

import struct

HEADER = b"Exif\0\0"
"""The bytes before a block in JPEG, and by mistake in some PNG and WebP files."""
ORIENTATION = 0x0112


def read_orientation(exif: bytes) -> int:
    """Reads tag 0x0112 of a block's first directory (Exif 2.32, 4.6.4). Returns 1, which is upright, if it is absent or
    the block is malformed.
    """
    exif = exif.removeprefix(HEADER)
    order = {b"II": "<", b"MM": ">"}.get(exif[:2])
    if order is None:
        return 1
    try:
        directory = struct.unpack_from(order + "I", exif, 4)[0]
        for entry in range(struct.unpack_from(order + "H", exif, directory)[0]):
            tag, _, _, value = struct.unpack_from(order + "HHIH", exif, directory + 2 + 12 * entry)
            if tag == ORIENTATION:
                return int(value)
    except struct.error:
        return 1
    return 1
