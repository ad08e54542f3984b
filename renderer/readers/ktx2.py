"""Decodes KTX2 textures of Basis Universal (ETC1S or UASTC) with opengl-basisu (KTX 2.0; KHR_texture_basisu)."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, cast

from ciir.errors import Unreadable, UnsupportedType, advise_extra

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels

_LEVELS = 80
"""The offset of the index of levels, largest first: offset, length, and length without supercompression."""
_BLOCK_BYTES = 16


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns the RGBA of the largest level, and the orientation, which is always 1.

    Raises `UnsupportedType` if opengl-basisu is not installed.
    """
    try:
        import opengl_basisu
    except ImportError as error:
        raise UnsupportedType(
            f"{name}: a KTX2 texture, and opengl-basisu is not installed; run {advise_extra('basisu')}, or save "
            "it as PNG, JPEG or WebP"
        ) from error
    texture = opengl_basisu.open(data)
    height, width = texture.height, texture.width
    check_size(height, width)
    _, _, unpacked = struct.unpack_from("<QQQ", data, _LEVELS)
    if unpacked > _BLOCK_BYTES * -(-height // 4) * -(-width // 4):
        raise Unreadable(f"{name}: {unpacked:,} bytes for {height}x{width} pixels; the KTX2 file is corrupt")
    return cast("Pixels", texture.transcode("rgba8").data), 1
