"""Notes on maps that may be wrong: where the search ended, and what no disparity fits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.renderer.focus.stereo.search_range import ends_search, find_reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

MISMATCH = 0.5
"""Share of the largest difference that counts, from which on nothing fits a pixel."""
MOST_MISMATCHED = 0.4
"""Largest share of such pixels without a note: outlines and mirrors have them, and fine texture halfway between two
planes."""
LARGEST_PIECE = 0.05
"""Largest share of them in one piece without a note: captured views have up to half a percent, and a pinhole array of
50x50 lenses, with texture that is too fine for it, 3 %."""


def note_reach(limits: tuple[float, float], size: tuple[int, int]) -> list[str]:
    """Returns a note if limits that were found end where the search did."""
    reach = find_reach(size)
    note = (
        f"disparities are searched up to {reach:g} pixels per view, and some reach that; give limits to search further"
    )
    return [note] if ends_search(limits, size) else []


def find_mismatched(cost: NDArray[np.float32], most_cost: NDArray[np.float32], noise: float) -> NDArray[np.bool_]:
    """Returns the pixels `(H, W)` that nothing fits. `noise`: the standard deviation of the compared pictures'
    noise.
    """
    by_noise = 2 * 2**0.5 * noise  # for the two terms of a cost, each from differences of two pictures
    found: NDArray[np.bool_] = cost.min(axis=0) > np.hypot(MISMATCH * most_cost, by_noise)
    return found


def note_mismatched(mismatched: NDArray[np.bool_], planes: NDArray[np.float64]) -> list[str]:
    """Returns a note if nothing fits much of the view, or a large piece of it, such as something near."""
    share = float(mismatched.mean())
    pieces, _ = ndimage.label(ndimage.binary_opening(mismatched, np.ones((3, 3))))
    largest = np.bincount(pieces.ravel())[1:].max(initial=0) / mismatched.size
    note = (
        f"nothing fits {100 * share:.0f} % of the pixels at disparities from {planes[0]:.2f} to {planes[-1]:.2f}: "
        "disparities may be larger (give limits), the views may be in a wrong order, or things may change between views"
    )
    return [note] if share > MOST_MISMATCHED or largest > LARGEST_PIECE else []
