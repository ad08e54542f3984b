"""Decodes WebP by Pillow: one picture, RGB or RGBA of 8 bit (RFC 9649)."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING

import numpy as np

# Not Image.open, which would try other decoders and warn of large pictures.
from PIL.WebPImagePlugin import WebPImageFile

from ciir.errors import Unreadable, UnsupportedType

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels

_ANIMATION = 0x02


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Pixels as stored, and the orientation, which is always 1.

    Raises `UnsupportedType` for an animation, `Unreadable` for other RIFF files.
    """
    height, width = _read_size(data, name)
    check_size(height, width)
    with WebPImageFile(io.BytesIO(data)) as image:  # allocates the canvas as it opens the file
        return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB")), 1


def _read_size(data: bytes, name: str) -> tuple[int, int]:
    """Height and width, from the header of the first chunk (RFC 9649, sections 2.5 to 2.7 and 3.4)."""
    kind = data[8:16]
    if kind == b"WEBPVP8X":
        if data[20] & _ANIMATION:
            raise UnsupportedType(f"{name}: an animated WebP; give its pictures one by one")
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"WEBPVP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    elif kind == b"WEBPVP8 ":
        width, height = (side & 0x3FFF for side in struct.unpack_from("<HH", data, 26))
    else:
        raise Unreadable(f"{name}: a RIFF file that holds no WebP picture; give a picture")
    return height, width
