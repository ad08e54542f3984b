"""Reads the sizes of pictures from the start of their files without loading a decoder."""

from __future__ import annotations

import re
import struct
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from ciir.renderer.readers.registry import PictureFormat, find_by_signature

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

Size = tuple[int, int]
"""The height and width as stored."""
START_BYTES = 1 << 16
"""How much of a file is read to find the size: a JPEG's size may come after metadata and a colour profile."""
NETPBM_HEADER = re.compile(rb"P([56])" + 3 * rb"(?:\s|#[^\r\n]*+[\r\n])++(\d{1,10})" + rb"\s")
"""The kind, width, height and level of white of a PPM or PGM, with comments between them."""
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
START_OF_SCAN = 0xDA
_WIDTH, _LENGTH = 256, 257
_INTEGERS = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""The struct formats of the integers in TIFF tags, by type."""


@runtime_checkable
class StartReader(Protocol):
    """Files whose start can be read without the rest of them."""

    def read_start(self, key: str, length: int) -> bytes | None:
        """Returns the first bytes of a file, or all of a shorter one; None if the whole file would have to be read."""


def read_start(files: Mapping[str, bytes], key: str, length: int) -> bytes | None:
    """Reads the start of any file of a bundle, as `StartReader.read_start` does."""
    if isinstance(files, StartReader):
        return files.read_start(key, length)
    return files[key][:length] if isinstance(files, dict) else None


def find_size(files: Mapping[str, bytes], key: str) -> Size | None:
    """Returns a picture's size from its first `START_BYTES`, or None if they don't state it or can't be read alone."""
    start = read_start(files, key, START_BYTES)
    entry = None if start is None else find_format(start)
    return None if start is None or entry is None else read_size(entry, start)


def find_format(start: bytes) -> PictureFormat | None:
    """Returns the format of the picture whose file starts with these bytes, or None if it is not a picture."""
    return next((entry for entry in find_by_signature(start) if isinstance(entry, PictureFormat)), None)


def read_size(entry: PictureFormat, start: bytes) -> Size | None:
    """Returns the size of a picture of this format whose file starts with `start`, or None if that doesn't state it."""
    with suppress(Exception):  # damaged files raise many kinds of errors
        return _READERS[entry.name](start)
    return None


def read_webp(data: bytes) -> Size | None:
    """Reads the header of the first chunk (RFC 9649, sections 2.5 to 2.7 and 3.4); None for another RIFF file."""
    kind = data[8:16]
    if kind == b"WEBPVP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"WEBPVP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    elif kind == b"WEBPVP8 ":
        width, height = (side & 0x3FFF for side in struct.unpack_from("<HH", data, 26))
    else:
        return None
    return height, width


def _read_png(data: bytes) -> Size:
    width, height = struct.unpack_from(">II", data, 16)
    return height, width


def _read_jpeg(data: bytes) -> Size:
    """Reads the largest frame header before the first scan (ITU-T T.81, B.2.2): decoders take one of several."""
    headers = [segment for kind, segment in list_segments(data) if kind in _FRAME_HEADERS]
    sizes: list[Size] = [struct.unpack_from(">HH", header, 5) for header in headers]
    return max(sizes, key=lambda size: size[0] * size[1])


def list_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yields the marker of each JPEG segment, and the segment with it. The last is all data from the first scan on."""
    offset = 2
    while (start := struct.unpack_from(">BB", data, offset)) != (0xFF, START_OF_SCAN):
        if start[0] != 0xFF:
            raise ValueError("bytes between JPEG segments")
        if start[1] == 0xFF:  # fill
            offset += 1
            continue
        segment = data[offset : offset + 2 + struct.unpack_from(">H", data, offset + 2)[0]]
        yield start[1], segment
        offset += len(segment)
    yield START_OF_SCAN, data[offset:]


def _read_tiff(data: bytes) -> Size:
    """Reads the first directory (TIFF 6.0, section 2; BigTIFF). If a tag occurs twice, the largest number counts."""
    order = "<" if data[:2] == b"II" else ">"
    is_big = data[2:4] in (b"+\0", b"\0+")
    offset, count, step = ("Q", "Q", 20) if is_big else ("I", "H", 12)
    (directory,) = struct.unpack_from(order + offset, data, struct.calcsize(offset))
    (entries,) = struct.unpack_from(order + count, data, directory)
    sides = {_WIDTH: 0, _LENGTH: 0}
    for entry in range(entries):
        at = directory + struct.calcsize(count) + step * entry
        tag, kind = struct.unpack_from(order + "HH", data, at)
        if tag in sides:
            (value,) = struct.unpack_from(order + _INTEGERS[kind], data, at + step - struct.calcsize(offset))
            sides[tag] = max(sides[tag], value)
    return sides[_LENGTH], sides[_WIDTH]


def _read_netpbm(data: bytes) -> Size | None:
    header = NETPBM_HEADER.match(data)
    return None if header is None else (int(header[3]), int(header[2]))


def _read_bmp(data: bytes) -> Size:
    """Reads the header: 16-bit sides in that of OS/2, else 32 bits with a negative height for rows from the top."""
    (header,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", data, 18)
    return abs(height), width


def _read_ktx2(data: bytes) -> Size:
    width, height = struct.unpack_from("<II", data, 20)
    return height, width


_READERS: dict[str, Callable[[bytes], Size | None]] = {
    "PNG": _read_png,
    "JPEG": _read_jpeg,
    "TIFF": _read_tiff,
    "WebP": read_webp,
    "PPM": _read_netpbm,
    "BMP": _read_bmp,
    "KTX2": _read_ktx2,
}
