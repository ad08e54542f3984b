"""Disparity between two views to a hundredth of a pixel, patch by patch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from numpy.typing import NDArray

PATCH = 24
"""Side of a patch, pixels."""
STEP = 12
"""From one patch to the next."""
TEXTURE = 4.0
"""Least standard deviation of the gradient along the shift, 8-bit levels a pixel: less is a flat patch."""
ROUNDS = 12
BLUR = 1.0
"""Standard deviation of the Gaussian that both views go through, pixels: the linear fit needs smooth pictures."""
FIT = 0.9
"""Least correlation of a patch with what it was moved onto: below it the two show different things."""


def estimate_disparities(first: NDArray[np.float64], second: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """How far each patch of `first` moves along `axis` (0 down, 1 right) to `second`, in pixels; NaN where a patch is
    flat or has no counterpart within 4 pixels. `(rows, cols)` of patches.

    `first` and `second`: luma, 8-bit levels, `(H, W)`. Iterated least squares on the gradient (Lucas and Kanade,
    IJCAI 1981), shifts by cubic splines, from the best of the whole shifts.
    """
    one, other = (ndimage.gaussian_filter(view.astype(float), BLUR) for view in (first, second))
    rows = range(8, one.shape[0] - PATCH - 7, STEP)
    cols = range(8, one.shape[1] - PATCH - 7, STEP)
    coefficients = ndimage.spline_filter(other)
    return np.array([[_shift(one, coefficients, row, col, axis) for col in cols] for row in rows])


def _shift(one: NDArray[np.float64], other: NDArray[np.float64], row: int, col: int, axis: int) -> float:
    patch = one[row : row + PATCH, col : col + PATCH]
    y, x = np.mgrid[row : row + PATCH, col : col + PATCH].astype(float)

    def moved(shift: float) -> NDArray[np.float64]:
        place = (y + shift, x) if axis == 0 else (y, x + shift)
        return np.asarray(ndimage.map_coordinates(other, place, order=3, prefilter=False, mode="nearest"))

    if np.gradient(patch, axis=axis).std() < TEXTURE:
        return float("nan")
    shift = min(np.arange(-4.0, 4.5), key=lambda whole: float(np.square(moved(whole) - patch).sum()))
    for _ in range(ROUNDS):
        there = moved(shift)
        slope = np.gradient(there, axis=axis)
        shift -= float((slope * (there - patch)).sum() / max(1e-9, float((slope * slope).sum())))
    is_found = abs(shift) <= 4.5 and np.corrcoef(moved(shift).ravel(), patch.ravel())[0, 1] >= FIT
    return shift if is_found else float("nan")
