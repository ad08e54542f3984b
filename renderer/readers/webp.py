"""Decodes WebP with Pillow: one picture, 8-bit RGB or RGBA (RFC 9649)."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING

import numpy as np

# Image.open is not used: it would try other decoders and warn about large pictures.
from PIL.WebPImagePlugin import WebPImageFile

from ciir.errors import Unreadable, UnsupportedType
from ciir.renderer.readers.metadata.exif import read_orientation
from ciir.renderer.readers.picture_sizes import read_webp

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels

_ANIMATION = 0x02


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns the pixels as stored, and the orientation, 1 to 8.

    Raises `UnsupportedType` for an animation, and `Unreadable` for other RIFF files.
    """
    if data[8:16] == b"WEBPVP8X" and data[20] & _ANIMATION:
        raise UnsupportedType(f"{name}: an animated WebP; give its pictures one by one")
    size = read_webp(data)
    if size is None:
        raise Unreadable(f"{name}: a RIFF file that holds no WebP picture; give a picture")
    check_size(*size)
    with WebPImageFile(io.BytesIO(data)) as image:  # allocates the canvas when it opens the file
        pixels = np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
    return pixels, read_orientation(_find_chunk(data, b"EXIF") or b"")


def find_profile(data: bytes) -> bytes | None:
    """Returns the colour profile, or None if there is none."""
    return _find_chunk(data, b"ICCP")


def _find_chunk(data: bytes, kind: bytes) -> bytes | None:
    """Returns the content of the first chunk of that kind, or None if there is none."""
    offset = 12
    while offset + 8 <= len(data):
        found, length = struct.unpack_from("<4sI", data, offset)
        if found == kind:
            return data[offset + 8 : offset + 8 + length]
        offset += 8 + length + length % 2
    return None
