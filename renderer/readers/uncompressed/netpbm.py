"""Decodes binary PPM and PGM, 8 and 16 bit (netpbm.sourceforge.net/doc/ppm.html and pgm.html).

Pillow 13.0.0 is not used: it rounds 16-bit colours to 8 bit, and spreads grey of 10 bits over 16.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.picture_sizes import NETPBM_HEADER

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels

LARGEST_WHITE = 65535
_CHANNELS = {b"5": 1, b"6": 3}


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns grey or RGB, and the orientation, which is always 1.

    The header states the level of white. If that has ones in all its bits and at least 8 of them (255, 1023, 4095,
    65535), levels are returned as stored. Otherwise they are multiplied, and rounded, so that white gets the next such
    level: 1 becomes 255, and 1000 becomes 1023. Different levels stay different.

    Raises `Unreadable` for a corrupt header, missing pixels, bytes after the pixels, and levels above white.
    """
    header = NETPBM_HEADER.match(data)
    if header is None:
        raise Unreadable(f"{name}: the PPM or PGM header has no width, height and level of white; save it again")
    width, height, white = (int(header[number]) for number in (2, 3, 4))
    if not 1 <= white <= LARGEST_WHITE:
        raise Unreadable(f"{name}: the level of white (maxval) is {white}, not 1 to {LARGEST_WHITE}; save it again")
    check_size(height, width)
    shape = height, width, _CHANNELS[header[1]]
    stored = np.dtype(np.uint8 if white <= 0xFF else ">u2")
    _check_length(data, header.end(), shape, stored.itemsize, name)
    samples = np.frombuffer(data, stored, height * width * shape[2], header.end())
    if (largest := int(samples.max())) > white:
        order = " with the high byte of each sample first" if stored.itemsize > 1 else ""
        raise Unreadable(f"{name}: has level {largest}, but white (maxval) is {white}; save it again{order}")
    return _fill_bits(cast("Pixels", samples.reshape(shape)), white), 1


def _check_length(data: bytes, start: int, shape: tuple[int, int, int], sample_bytes: int, name: str) -> None:
    """Checks that as many bytes as the pixels need follow from `start` on, and then at most white space."""
    height, width, channels = shape
    length, expected = len(data) - start, height * width * channels * sample_bytes
    what = f"{name}: {length:,} bytes of pixels instead of {expected:,} ({height}x{width} pixels of {channels} x "
    what += f"{8 * sample_bytes} bit)"
    if length < expected:
        raise Unreadable(f"{what}: damaged or cut off; send the whole file")
    if data[start + expected :].strip():
        raise Unreadable(f"{what}; save it again, as the only picture of its file")


def _fill_bits(pixels: Pixels, white: int) -> Pixels:
    """Returns `pixels` with `white` raised to the next level with ones in all its bits, 8 or more."""
    top = max(0xFF, 2 ** white.bit_length() - 1)
    if white == top:
        return pixels
    levels = ((np.arange(white + 1) * top + white // 2) // white).astype(pixels.dtype.newbyteorder("="))
    filled = np.empty(pixels.shape, levels.dtype)
    for row, stored in zip(filled, pixels, strict=True):  # NumPy makes 8 bytes of each level that it looks up
        row[...] = levels[stored]
    return filled
