"""Finds a light field's range of disparities in small views, by comparing all disparities up to an eighth of a view."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.renderer.focus.stereo.matching import match
from ciir.renderer.focus.stereo.sweep import Sweep
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.views import View

LEAST_SIDE = 4
"""Pixels along a side of the smallest views: half of their pixels are at the border."""
COARSE = 96
"""Pixels along the longer side of the pictures in which the range of disparities is found."""
COARSE_PARTS = 4
"""Planes per pixel of disparity in those pictures."""
SURE = 0.5
"""Confidence from which a pixel counts, or the median confidence if that is lower."""
EVEN = 0.5
"""Most pixels by which the disparities around a pixel may differ for it to count: around an error they differ more."""
MARGIN = 0.08
"""Margin on each side of a range, as a share of it."""
TEXTURE = 2.0
"""Smallest difference to the next pixel, in 8-bit levels, with which a pixel has texture."""
LEAST_SHARE = 0.01
"""Smallest share of the pixels that must show a disparity for a usual range."""
GAP = 1.0
"""Largest gap, in pixels of those pictures, between disparities that belong to one range in the corners of the grid."""


def find_limits(views: NDArray[Any], *, corners: bool = True) -> tuple[float, float]:
    """Returns the range of disparities that the centre view sees and, with `corners`, that only the corner views see.

    A corner view sees what is nearer or farther at the borders. It has no view on two of its sides, so repeating
    patterns look there like disparities far from all others: its range extends the centre's without a gap of over
    `GAP`.
    """
    views = raise_levels(views, count_unused_bits(views))
    grid = views.shape[:2]
    factor = _find_factor(views.shape[2:4])
    center = _look_coarsely(views, center_view(*grid), factor)
    ranges = [_find_range(center)]
    for corner in product(*({0, count - 1} for count in grid)) if corners and center.size else ():
        found = _look_coarsely(views, corner, factor, window=5)
        ranges.append(_find_range(_select_joined(found, *_find_ends(center))))
    return factor * min(low for low, _ in ranges), factor * max(high for _, high in ranges)


def find_reach(size: tuple[int, int]) -> float:
    """Returns the largest disparity, in either direction, that is searched in views of `size`."""
    factor = _find_factor(size)
    return factor * _count_planes(max(size) // factor) / COARSE_PARTS


def ends_search(limits: tuple[float, float], size: tuple[int, int]) -> bool:
    """Returns whether `find_limits` gave these limits for views of `size` because the search ends there."""
    low, high = limits
    return max(-low, high) - MARGIN / (1 + 2 * MARGIN) * (high - low) >= find_reach(size)


def find_usual_range(views: NDArray[Any]) -> tuple[float, float] | None:
    """Returns the disparities between which the centre view lies, except 2 % at each end: approximate, but quick.

    Returns None for views of less than `LEAST_SIDE` pixels along a side, and if pixels with texture hardly show any.
    """
    if min(views.shape[2:4]) < LEAST_SIDE:
        return None
    factor = _find_factor(views.shape[2:4])
    found = _look_coarsely(views, center_view(*views.shape[:2]), factor, textured=True)
    if found.size < LEAST_SHARE * (views.shape[2] // factor) * (views.shape[3] // factor):
        return None
    low, high = np.quantile(found, (0.02, 0.98))
    return factor * float(low), factor * float(high)


def _look_coarsely(
    views: NDArray[Any], view: View, factor: int, window: int = 1, *, textured: bool = False
) -> NDArray[np.float32]:
    """Returns the disparities that `view` shows with confidence, `(n,)`, from a sweep over pictures that are smaller by
    `factor`, in pixels of those, with only the nearest views. `window`: side of a median filter against errors.
    `textured`: whether only pixels with texture count.
    """
    height, width = views.shape[2:4]
    rows, cols = (slice(max(0, at - 2), at + 3) for at in view)
    near = views[rows, cols, : height // factor * factor, : width // factor * factor]
    blocks = (*near.shape[:2], height // factor, factor, width // factor, factor, near.shape[4])
    scale = np.float32(255 / np.iinfo(views.dtype).max)
    small = scale * near.reshape(blocks).mean(axis=(3, 5), dtype=np.float32)
    most = _count_planes(max(small.shape[2:4]))
    numbers = range(-most, most + 1)
    place = view[0] - rows.start, view[1] - cols.start
    sweep = Sweep(small, place, parts=COARSE_PARTS, farthest=2)
    disparity, confidence = match(sweep.compare(numbers), sweep.own, np.array(numbers) / COARSE_PARTS)
    steps = ndimage.maximum_filter(disparity, 3) - ndimage.minimum_filter(disparity, 3)
    is_sure = (confidence > 0) & (confidence >= np.fmin(SURE, np.median(confidence))) & (steps <= EVEN)
    if textured:
        is_sure &= find_texture(sweep.own, views.shape[:2])
    found: NDArray[np.float32] = ndimage.median_filter(disparity, window, mode="nearest")[is_sure]
    return found


def find_texture(picture: NDArray[np.float32], grid: tuple[int, ...]) -> NDArray[np.bool_]:
    """Returns the pixels, `(H, W)`, that change along an axis along which the views of a `grid` (rows, columns) move.

    `picture`: `(C, H, W)` in 8-bit levels.
    """
    axes = [axis for axis, count in zip((1, 2), grid, strict=True) if count > 1]
    slopes = [np.abs(np.gradient(picture, axis=axis)).max(axis=0) for axis in axes]
    found: NDArray[np.bool_] = np.max(slopes, axis=0) >= TEXTURE
    return found


def _find_factor(size: tuple[int, ...]) -> int:
    """Returns the factor by which views of `size` are made smaller."""
    return max(1, min(-(-max(size) // COARSE), min(size) // LEAST_SIDE))


def _count_planes(side: int) -> int:
    """Returns how many planes are compared on each side of disparity 0: up to an eighth of the longer side."""
    return side // 4 * 2


def _find_ends(found: NDArray[Any]) -> tuple[float, float]:
    """Returns the smallest and the largest disparity except half a percent at each end; 0 if none was found."""
    low, high = np.quantile(found, (0.005, 0.995)) if found.size else (0.0, 0.0)
    return float(low), float(high)


def _find_range(found: NDArray[Any]) -> tuple[float, float]:
    """Returns the ends with a margin: near the border, where few views reach, the nearest content is not seen."""
    low, high = _find_ends(found)
    margin = max(0.5 / COARSE_PARTS, MARGIN * (high - low))
    return low - margin, high + margin


def _select_joined(found: NDArray[Any], low: float, high: float) -> NDArray[Any]:
    """Returns the disparities, `(n,)`, that can be reached from the range of `low` to `high` without a gap of over
    `GAP`.
    """
    ordered = np.sort(np.append(found, [low, high]))
    groups = np.cumsum(np.diff(ordered, prepend=ordered[0]) > GAP)
    first, last = groups[np.searchsorted(ordered, [low, high])]
    joined: NDArray[Any] = ordered[(groups >= first) & (groups <= last)]
    return joined
