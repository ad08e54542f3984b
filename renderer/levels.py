"""Levels of 8 and 16 bits: how to make them of other numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.bit_depth import raise_levels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels


def round_levels(picture: NDArray[np.float32], dtype: np.dtype[Any]) -> Pixels:
    """The nearest levels of `dtype`, uint8 or uint16, to `picture`, of any shape."""
    levels: Pixels = np.rint(picture).clip(0, np.iinfo(dtype).max).astype(dtype)
    return levels


def round_to_8_bit(picture: Pixels, unused: int) -> NDArray[np.uint8]:
    """`picture` of any shape `(..., C)` in 8 bits; one of 16 raised by `unused` bits first."""
    if picture.dtype == np.uint8:
        return picture.astype(np.uint8, copy=False)
    rounded: NDArray[np.uint8] = (raise_levels(picture, unused) / 257).round().astype(np.uint8)
    return rounded


def note_rounding(name: str, dtype: np.dtype[Any], unused: int) -> list[str]:
    """Notes on views of `dtype` in the 8 bits of the format `name`, raised by `unused` bits of
    `ciir.bit_depth.count_unused_camera_bits`; none for uint8.
    """
    if dtype != np.uint16:
        return []
    raised = f"{name}: no level is over {2 ** (16 - unused) - 1}, so levels are multiplied by {2**unused}"
    return [f"{name}: 16 bits are rounded to 8", *([raised] if unused else [])]


def advise_levels(views: Any, name: str = "views") -> str:
    """How to make 8 or 16 bits of `views`, by their range, shares of white or levels, as code on a variable `name`.

    Resampled numbers lie a little outside of their range, so floating-point ones belong to a range up to twice its end.
    """
    if not isinstance(views, np.ndarray) or views.dtype.kind not in "iuf" or not views.size:
        return f"(255 * {name}).round().astype('u1')"
    low, high = views.min(), views.max()
    beyond = 2 if views.dtype.kind == "f" else 1
    white = 255 if high <= 255 * beyond else 65535
    if not high > beyond:  # true for NaN, too
        clipped = f"{name}.clip(0, 1)" if low < 0 or high > 1 else name
        return f"(255 * {clipped}).round().astype('u1')"
    clipped = f"{name}.clip(0, {white})" if low < 0 or high > white else name
    return f"{clipped}.round().astype('u{1 if white == 255 else 2}')"
