"""Levels of 8 and 16 bits: how to make them of other numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels


def round_levels(picture: NDArray[np.float32], dtype: np.dtype[Any]) -> Pixels:
    """The nearest levels of `dtype`, uint8 or uint16, to `picture`, of any shape."""
    levels: Pixels = np.rint(picture).clip(0, np.iinfo(dtype).max).astype(dtype)
    return levels


def advise_levels(views: Any) -> str:
    """How to make 8 or 16 bits of `views`, by their range: shares of white, or levels.

    Resampled numbers lie a little outside of their range, so floating-point ones belong to a range up to twice its end.
    """
    if not isinstance(views, np.ndarray) or views.dtype.kind not in "iuf" or not views.size:
        return "(255 * views).round().astype('u1')"
    low, high = views.min(), views.max()
    beyond = 2 if views.dtype.kind == "f" else 1
    white = 255 if high <= 255 * beyond else 65535
    if not high > beyond:  # true for NaN, too
        clipped = "views.clip(0, 1)" if low < 0 or high > 1 else "views"
        return f"(255 * {clipped}).round().astype('u1')"
    clipped = f"views.clip(0, {white})" if low < 0 or high > white else "views"
    return f"{clipped}.round().astype('u{1 if white == 255 else 2}')"
