"""Decodes PNG, 8 and 16 bit (W3C PNG, third edition), by Pillow.

Not by imagecodecs: each corrupt PNG costs it (2026.3.6) one reference to None, which ends a Python 3.11 process after
some thousands of them.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

# Not Image.open, which would try other decoders and warn of large pictures.
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
    """Pixels of any PNG, with palettes, 1 to 4 bits and a transparent colour expanded; and the orientation, 1 to 8."""
    if data[12:16] != b"IHDR" or len(data) < 33:
        raise Unreadable(f"{name}: the PNG header is cut off or corrupt; send the whole file")
    width, height, depth, colour = struct.unpack_from(">IIBB", data, 16)
    check_size(height, width)
    chunks, exif = _split_chunks(data, name)
    pixels = _decode_16(chunks, colour) if depth == 16 and colour != GREY else _decode_8(chunks, depth)
    return pixels, read_orientation(exif)


def find_text(data: bytes, keyword: str) -> str | None:
    """The first text (chunk tEXt) with that keyword, before the pixels; None where there is none."""
    for kind, chunk in _list_chunks(data):
        if kind == b"IDAT":
            return None
        found, _, text = chunk[8:-4].partition(b"\0")
        if kind == b"tEXt" and found == keyword.encode("latin-1"):
            return text.decode("latin-1")
    return None


def find_profile(data: bytes) -> bytes | None:
    """The start of the colour profile (chunk iCCP), `PROFILE_BYTES` bytes at most; None where there is none."""
    for kind, chunk in _list_chunks(data):
        if kind == b"IDAT":
            return None
        if kind == b"iCCP":
            stream = chunk[8:-4].partition(b"\0")[2][1:]  # after the name and the method of compression
            return zlib.decompressobj().decompress(stream, PROFILE_BYTES)
    return None


def _decode_8(data: bytes, depth: int) -> Pixels:
    """Up to 8 bits, and 16-bit grey: Pillow keeps every bit of these."""
    with PngImageFile(io.BytesIO(data)) as image:
        key = image.info.get("transparency")
        if image.mode == "P":
            return np.asarray(image.convert("RGB" if key is None else "RGBA"))
        return _add_alpha(np.asarray(image.convert("L") if image.mode == "1" else image), key, depth)


def _decode_16(data: bytes, colour: int) -> Pixels:
    """16-bit colour or alpha: Pillow keeps their high bytes alone, so that it reads them twice."""
    if colour == GREY_ALPHA:  # 4 bytes a pixel, as 8-bit RGBA has: the same filters, the same bytes
        header = b"IHDR" + data[16:24] + bytes([8, RGB_ALPHA]) + data[26:29]
        data = data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]
        with PngImageFile(io.BytesIO(data)) as image:
            return np.asarray(image).view(">u2")
    with PngImageFile(io.BytesIO(data)) as image:
        high, key = np.asarray(image), image.info.get("transparency")
    with PngImageFile(io.BytesIO(data)) as image:  # the low byte is the high one in the other byte order
        image.tile = [tile._replace(args=str(tile.args).replace(";16B", ";16L")) for tile in image.tile]
        low = np.asarray(image)
    return _add_alpha(high.astype(np.uint16) << 8 | low, key, 16)


def _add_alpha(pixels: Pixels, key: int | tuple[int, ...] | None, depth: int) -> Pixels:
    """Adds alpha that is 0 where the pixel has the transparent colour `key` of chunk tRNS, given at `depth` bits."""
    if key is None:
        return pixels
    colours = pixels if pixels.ndim == 3 else pixels[..., np.newaxis]
    top = np.iinfo(pixels.dtype).max
    clear = (colours == np.array(key) * (top // (2**depth - 1))).all(axis=2, keepdims=True)
    return np.concatenate([colours, np.where(clear, 0, top).astype(pixels.dtype)], axis=2)


def _split_chunks(data: bytes, name: str) -> tuple[bytes, bytes]:
    """The PNG without the chunks that hold no pixels, and its Exif block ("" where there is none).

    Texts and profiles are compressed, and swell on reading.
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
    """The kind of each whole chunk, and the chunk with its length and checksum."""
    offset = len(SIGNATURE)
    while offset + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, offset)
        chunk = data[offset : offset + 12 + length]
        if len(chunk) < 12 + length:
            return
        yield kind, chunk
        offset += len(chunk)
