"""Decodes 8-bit and 16-bit PNG (W3C PNG, third edition) with Pillow.

imagecodecs 2026.3.6 is not used: each corrupt PNG costs it one reference to None, which ends a Python 3.11 process
after some thousands of them.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

# Image.open is not used: it would try other decoders and warn about large pictures.
from PIL.PngImagePlugin import PngImageFile

from ciir.errors import Unreadable
from ciir.renderer.readers.metadata.exif import read_orientation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ciir.renderer.readers.pictures import Pixels

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, RGB, GREY_ALPHA, RGB_ALPHA = 0, 2, 4, 6  # colour types
PIXEL_CHUNKS = frozenset({b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"})

PROFILE_BYTES = 2**20


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns a PNG's pixels (palettes, 1 to 4 bits, transparent colours are expanded), and the orientation, 1 to 8."""
    if data[12:16] != b"IHDR" or len(data) < 33:
        raise Unreadable(f"{name}: the PNG header is cut off or corrupt; send the whole file")
    width, height, depth, colour = struct.unpack_from(">IIBB", data, 16)
    check_size(height, width)
    chunks, exif = _split_chunks(data, name)
    pixels = _decode_16(chunks, colour) if depth == 16 and colour != GREY else _decode_8(chunks, depth)
    return pixels, read_orientation(exif)


def find_text(data: bytes, keyword: str) -> str | None:
    """Returns the first text (chunk tEXt) with that keyword before the pixels, or None if there is none."""
    for kind, chunk in _list_chunks(data):
        if kind == b"IDAT":
            return None
        found, _, text = chunk[8:-4].partition(b"\0")
        if kind == b"tEXt" and found == keyword.encode("latin-1"):
            return text.decode("latin-1")
    return None


def find_profile(data: bytes) -> bytes | None:
    """Returns the start of the colour profile (chunk iCCP), at most `PROFILE_BYTES` bytes, or None if there is none."""
    for kind, chunk in _list_chunks(data):
        if kind == b"IDAT":
            return None
        if kind == b"iCCP":
            stream = chunk[8:-4].partition(b"\0")[2][1:]  # after the name and the method of compression
            return zlib.decompressobj().decompress(stream, PROFILE_BYTES)
    return None


def _decode_8(data: bytes, depth: int) -> Pixels:
    """Decodes pixels of up to 8 bits, and 16-bit grey: Pillow keeps every bit of these."""
    with PngImageFile(io.BytesIO(data)) as image:
        key = image.info.get("transparency")
        if image.mode == "P":
            return np.asarray(image.convert("RGB" if key is None else "RGBA"))
        return _add_alpha(np.asarray(image.convert("L") if image.mode == "1" else image), key, depth)


def _decode_16(data: bytes, colour: int) -> Pixels:
    """Decodes 16-bit colour or alpha. Pillow keeps only the high bytes, so the pixels are read twice."""
    if colour == GREY_ALPHA:  # 4 bytes a pixel, as in 8-bit RGBA: the same filters, the same bytes
        header = b"IHDR" + data[16:24] + bytes([8, RGB_ALPHA]) + data[26:29]
        data = data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]
        with PngImageFile(io.BytesIO(data)) as image:
            return np.asarray(image).view(">u2")
    with PngImageFile(io.BytesIO(data)) as image:
        high, key = np.asarray(image), image.info.get("transparency")
    with PngImageFile(io.BytesIO(data)) as image:  # the low byte is the high byte in the other byte order
        image.tile = [tile._replace(args=str(tile.args).replace(";16B", ";16L")) for tile in image.tile]
        low = np.asarray(image)
    return _add_alpha(high.astype(np.uint16) << 8 | low, key, 16)


def _add_alpha(pixels: Pixels, key: int | tuple[int, ...] | None, depth: int) -> Pixels:
    """Adds alpha that is 0 where a pixel has the transparent colour `key` of chunk tRNS, given at `depth` bits."""
    if key is None:
        return pixels
    colours = pixels if pixels.ndim == 3 else pixels[..., np.newaxis]
    top = np.iinfo(pixels.dtype).max
    clear = (colours == np.array(key) * (top // (2**depth - 1))).all(axis=2, keepdims=True)
    return np.concatenate([colours, np.where(clear, 0, top).astype(pixels.dtype)], axis=2)


def _split_chunks(data: bytes, name: str) -> tuple[bytes, bytes]:
    """Returns the PNG without the chunks that hold no pixels, and its Exif block ("" if there is none).

    Texts and profiles are compressed and grow when they are read.
    """
    kept, exif = [SIGNATURE], b""
    for kind, chunk in _list_chunks(data):
        if kind in PIXEL_CHUNKS:
            kept.append(chunk)
        if kind == b"eXIf":
            exif = exif or chunk[8:-4]
        if kind == b"IEND":
            return b"".join(kept), exif
    raise Unreadable(f"{name}: the PNG ends too early (no IEND chunk); send the whole file")


def _list_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yields the kind of each complete chunk, and the chunk with its length and checksum."""
    offset = len(SIGNATURE)
    while offset + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, offset)
        chunk = data[offset : offset + 12 + length]
        if len(chunk) < 12 + length:
            return
        yield kind, chunk
        offset += len(chunk)
