"""Bits of a level: 16-bit pictures of cameras with fewer, and pictures whose levels are not yet rounded to 8.

A camera of 10 or 12 bits fills a part of 16. Networks were trained on pictures that fill the range, and are up to 10 dB
worse on ones that are so dark. So levels are multiplied by a power of two before a network, and divided after it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

BITS = 16
LEAST = 8
"""Bits that are always taken as used: a picture with fewer is dark."""


def count_unused_bits(*pictures: NDArray[Any]) -> int:
    """How many of the upper bits no pixel of 16-bit `pictures` `(..., C)` uses, 0 to 8; 0 for 8-bit ones.

    Alpha, the last of 2 or 4 channels, doesn't count.
    """
    if pictures[0].dtype != np.uint16:
        return 0
    largest = max((int(_colours(picture).max()) for picture in pictures if picture.size), default=0)
    return BITS - max(LEAST, largest.bit_length())


def count_unused_camera_bits(*pictures: NDArray[Any]) -> int:
    """How many of 16 bits the camera of 16-bit `pictures` doesn't have, for outputs of 8 bits: as `count_unused_bits`,
    but even. Cameras have 8, 10, 12, 14 or 16 bits, so that a brightest level of 11 bits is a darker picture of 12.
    """
    return count_unused_bits(*pictures) // 2 * 2


def raise_levels(picture: NDArray[Any], unused: int) -> NDArray[Any]:
    """`picture` with its colours multiplied by `2**unused`, a new array where that is not 1."""
    if not unused:
        return picture
    raised = picture.copy()
    _colours(raised)[...] <<= unused
    return raised


def lower_levels(picture: NDArray[Any], unused: int) -> NDArray[Any]:
    """Undoes `raise_levels`, rounded to nearest, in place."""
    if unused:
        colours, half = _colours(picture), np.uint16(2 ** (unused - 1))
        np.minimum(colours, np.uint16(2**BITS - 1) - half, out=colours)  # which 16 bits hold with half a level more
        colours += half
        colours >>= unused
    return picture


def round_to_depth(picture: NDArray[Any], depth: np.dtype[Any]) -> NDArray[Any]:
    """`picture` of 16 bits in the type `depth`: the same array for 16 bits; for 8 its levels, which are 257 times as
    large, rounded to the nearest; a fraction of 128/257 counts as a half.
    """
    if depth != np.uint8:
        return picture
    levels = picture >> 8
    np.subtract(picture, levels, out=levels)  # 256 times the level, where it is whole
    levels += np.uint16(128)
    levels >>= 8
    return levels.astype(np.uint8)


def limit_levels(picture: NDArray[Any], unused: int) -> NDArray[Any]:
    """`picture` of 16 bits with no colour over the levels of `16 - unused` bits, in place."""
    if unused:
        colours = _colours(picture)
        np.minimum(colours, np.uint16(2 ** (BITS - unused) - 1), out=colours)
    return picture


def _colours(picture: NDArray[Any]) -> NDArray[Any]:
    return picture[..., :-1] if picture.shape[-1] in (2, 4) else picture
