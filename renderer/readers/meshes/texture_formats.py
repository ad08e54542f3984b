"""Picture formats that are read only as textures, by Pillow: TGA and the first picture of a GIF."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.registry import PictureFormat

if TYPE_CHECKING:
    from collections.abc import Callable

    from PIL.Image import Image

    from ciir.renderer.readers.pictures import Pixels

_GIF = PictureFormat(
    name="GIF", suffixes=(".gif",), signatures=(b"GIF87a", b"GIF89a"), reader="meshes.texture_formats:decode_gif"
)
_TGA = PictureFormat(name="TGA", suffixes=(".tga",), reader="meshes.texture_formats:decode_tga")
_TGA_HEADER = 18
_MAP_TYPES, _TGA_KINDS, _DEPTHS = (0, 1), (1, 2, 3, 9, 10, 11), (8, 16, 24, 32)
_ALPHA_BITS = 0x0F
"""The bits in the last byte of a TGA's header that hold the number of alpha bits."""


def find_texture_format(name: str, data: bytes) -> PictureFormat | None:
    """Finds the format by the first bytes, or for TGA, which has no signature, by the name and the header. Returns None
    if it is none of these formats.
    """
    if data.startswith(_GIF.signatures):
        return _GIF
    if len(data) <= _TGA_HEADER or not name.lower().endswith(_TGA.suffixes):
        return None
    map_type, kind, depth = data[1], data[2], data[16]
    return _TGA if map_type in _MAP_TYPES and kind in _TGA_KINDS and depth in _DEPTHS else None


# The decoders below don't use Image.open, which would try other decoders and warn about large pictures.


def decode_tga(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:  # noqa: ARG001
    """Decodes a TGA as a `PictureDecoder`. The picture is opaque if the header states no alpha bits (Truevision TGA
    2.0, field 5.6).
    """
    from PIL.TgaImagePlugin import TgaImageFile

    with TgaImageFile(io.BytesIO(data)) as image:
        check_size(image.height, image.width)
        pixels = _convert(image)
    return (pixels if data[17] & _ALPHA_BITS else pixels[..., :3]), 1


def decode_gif(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Decodes a GIF's first picture as a `PictureDecoder`. Raises `Unreadable` if it extends beyond the screen."""
    from PIL.GifImagePlugin import GifImageFile

    width, height = struct.unpack_from("<HH", data, 6)
    check_size(height, width)
    left, top, across, down = struct.unpack_from("<HHHH", data, _find_picture(data) + 1)
    if left + across > width or top + down > height:  # Pillow would allocate more than was checked
        raise Unreadable(f"{name}: a GIF whose first picture extends beyond its {height}x{width} pixels; save it again")
    with GifImageFile(io.BytesIO(data)) as image:
        return _convert(image), 1


def _find_picture(data: bytes) -> int:
    """Returns the offset of a GIF's first image descriptor (GIF89a, section 20), after the palette and extensions."""
    at = 13 + (3 << (data[10] & 7) + 1 if data[10] & 0x80 else 0)
    while data[at] == ord("!"):
        at += 2
        while data[at]:
            at += data[at] + 1
        at += 1
    if data[at] != ord(","):
        raise ValueError("no picture")
    return at


def _convert(image: Image) -> Pixels:
    return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
