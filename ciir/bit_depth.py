"""Bits per level: 16-bit pictures from cameras with fewer bits, and 16-bit pictures that are still to be rounded to 8.

A camera of 10 or 12 bits fills only part of the 16-bit range. Networks were trained on pictures that fill the range,
and are up to 10 dB worse on such dark pictures. So levels are multiplied by a power of two before a network, and
divided by it afterwards. Dark pictures of 8 bits are treated in the same way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

BITS = 16
LEAST = 8
"""The number of bits that always count as used: a picture with fewer is dark."""
DARK = 2
"""Fewest unused bits of 8 for which an 8-bit picture is raised before a network. Without this, light-field networks
smear views with levels up to 31, which come out up to 8 dB worse than interpolated."""


def count_unused_bits(*pictures: NDArray[Any]) -> int:
    """Counts the upper bits that no pixel of 16-bit `pictures` `(..., C)` uses, 0 to 8; returns 0 for 8-bit pictures.

    Alpha, the last of 2 or 4 channels, doesn't count.
    """
    if pictures[0].dtype != np.uint16:
        return 0
    largest = max((int(_colours(picture).max()) for picture in pictures if picture.size), default=0)
    return BITS - max(LEAST, largest.bit_length())


def count_raised_bits(*pictures: NDArray[Any]) -> int:
    """Counts the bits by which `pictures` `(..., C)` are raised before a network: those of `count_unused_bits`, and for
    dark 8-bit pictures all upper bits that no pixel uses, if they are `DARK` or more.
    """
    if pictures[0].dtype != np.uint8:
        return count_unused_bits(*pictures)
    largest = max((int(_colours(picture).max()) for picture in pictures if picture.size), default=0)
    unused = 8 - max(1, largest.bit_length())
    return unused if unused >= DARK else 0


def count_unused_camera_bits(*pictures: NDArray[Any]) -> int:
    """Counts the bits of 16 that the camera of 16-bit `pictures` doesn't have, for outputs of 8 bits.

    The count is that of `count_unused_bits`, rounded down to an even number: cameras have 8, 10, 12, 14 or 16 bits, so
    a brightest level of 11 bits means a darker picture of 12 bits.
    """
    return count_unused_bits(*pictures) // 2 * 2


def raise_levels(picture: NDArray[Any], unused: int) -> NDArray[Any]:
    """Returns `picture` with its colours multiplied by `2**unused`, as a new array unless that factor is 1."""
    if not unused:
        return picture
    raised = picture.copy()
    _colours(raised)[...] <<= unused
    return raised


def lower_levels(picture: NDArray[Any], unused: int) -> NDArray[Any]:
    """Undoes `raise_levels` in place, rounding to the nearest level."""
    if unused:
        colours, half = _colours(picture), picture.dtype.type(2 ** (unused - 1))
        largest = picture.dtype.type(np.iinfo(picture.dtype).max)
        np.minimum(colours, largest - half, out=colours)  # so that adding half a level doesn't overflow
        colours += half
        colours >>= unused
    return picture


def round_to_depth(picture: NDArray[Any], depth: np.dtype[Any]) -> NDArray[Any]:
    """Returns the 16-bit `picture` in the type `depth`.

    For 16 bits this is the same array. For 8 bits, its levels, which are 257 times as large, are rounded to the
    nearest; a fraction of 128/257 counts as a half.
    """
    if depth != np.uint8:
        return picture
    levels = picture >> 8
    np.subtract(picture, levels, out=levels)  # 256 times the level, if that is whole
    levels += np.uint16(128)
    levels >>= 8
    return levels.astype(np.uint8)


def limit_levels(picture: NDArray[Any], unused: int) -> NDArray[Any]:
    """Limits the colours of the 16-bit `picture` to the levels of `16 - unused` bits, in place."""
    if unused:
        colours = _colours(picture)
        np.minimum(colours, np.uint16(2 ** (BITS - unused) - 1), out=colours)
    return picture


def _colours(picture: NDArray[Any]) -> NDArray[Any]:
    return picture[..., :-1] if picture.shape[-1] in (2, 4) else picture
