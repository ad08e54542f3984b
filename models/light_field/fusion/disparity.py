"""Estimates the disparity of every pixel of a view quickly, for fusion.

A plane sweep over its nearest neighbours in its row and column finds the disparity to a fraction of a pixel. Two steps
of least squares on the gradient (Lucas and Kanade, IJCAI 1981) refine it, the second one with views that are farther
away. `ciir.renderer.focus` is more exact, because it makes pixels agree with their neighbours, and takes 20 times
as long.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.fusion.warping import pad_edges, warp_picture

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.models.light_field.disparities.shifts import Plane
    from ciir.models.light_field.planes import Range
    from ciir.models.light_field.windows import View

STEP, FINE_STEP = 0.25, 0.15
"""Pixels between two planes, and for views that are matched, which gain by it if disparities are large."""
MOST_PLANES = 96
"""For wider ranges the planes lie further apart."""
PATCH = 5
"""Side of the square over which differences are averaged."""
LARGEST = np.float32(0.6**2)
"""Squared differences count up to this, in units of contrast: larger ones are other objects."""
NEAREST = 2
"""Views of each row and column that the sweep compares."""
FARTHEST = np.float32(0.5)
"""Most pixels by which each step of least squares changes a disparity."""
SOFT = np.float32(0.3**2)
"""Squared difference, in units of contrast, at which a pixel counts half in least squares."""
LEAST_SLOPE = np.float32(0.06**2)
"""Added to the mean squared gradient, in units of contrast: flat parts keep the disparity of their plane."""


def estimate_disparity(own: Plane, beside: Mapping[View, Plane], limits: Range, *, step: float = STEP) -> Plane:
    """Estimates by how many pixels the content of `own` moves towards larger coordinates from one view to the next.

    `own`: the view's luma in units of its contrast, `(H, W)`. `beside`: the luma of other views of its row and its
    column, by offset (down, right), of which one is 0. `limits`: the smallest and the largest disparity. `step`: pixels
    between two planes. Returns `(H, W)`.
    """
    nearest = _list_nearest(beside)
    disparity = _sweep(own, nearest, limits, step)
    farther = {offset: luma for offset, luma in beside.items() if offset not in nearest}
    for views in (nearest, farther or nearest):
        disparity += _find_step(own, views, disparity)
    return _remove_outliers(disparity)


def _list_nearest(beside: Mapping[View, Plane]) -> dict[View, Plane]:
    """Lists the nearest `NEAREST` views of the row and of the column."""
    by_distance = sorted(beside, key=lambda offset: abs(sum(offset)))
    lines = [[offset for offset in by_distance if offset[axis]] for axis in (0, 1)]
    return {offset: beside[offset] for line in lines for offset in line[:NEAREST]}


def _sweep(own: Plane, beside: Mapping[View, Plane], limits: Range, step: float) -> Plane:
    """Returns the disparity of the plane at which the views differ least."""
    from scipy import ndimage  # imported here because most jobs don't need it

    count = min(MOST_PLANES, max(2, math.ceil((limits.highest - limits.lowest) / step) + 1))
    planes = np.linspace(limits.lowest, limits.highest, count)
    lines = {offset: _make_lines(luma, offset, limits) for offset, luma in beside.items()}
    least = np.full(own.shape, np.inf, np.float32)
    best = np.empty_like(own)
    for plane in planes:
        cost = np.zeros_like(own)
        for (down, right), (axis, margin, padded) in lines.items():
            moved = _shift_lines(padded, plane * (down + right), margin, own.shape[axis])
            moved = moved if axis == 0 else moved.T
            difference = np.subtract(moved, own)
            np.square(difference, out=difference)
            cost += np.minimum(difference, LARGEST, out=difference)
        cost = ndimage.uniform_filter(cost, PATCH, mode="nearest")
        is_better = cost < least
        np.copyto(least, cost, where=is_better)
        best[is_better] = plane
    return best


def _make_lines(luma: Plane, offset: View, limits: Range) -> tuple[int, int, Plane]:
    """Returns the axis along which content moves, the margin that it needs on each side, and `luma` with it, with that
    axis first.
    """
    axis = 0 if offset[0] else 1
    margin = math.ceil(max(map(abs, limits)) * abs(sum(offset))) + 1
    padded = np.pad(luma, [(margin, margin) if side == axis else (0, 0) for side in range(2)], mode="edge")
    return axis, margin, padded if axis == 0 else np.ascontiguousarray(padded.T)


def _shift_lines(lines: Plane, by: float, margin: int, count: int) -> Plane:
    """Returns `count` lines that lie `by` lines after the margin, by linear interpolation."""
    whole = math.floor(by)
    share = np.float32(by - whole)
    first = margin + whole
    moved = lines[first : first + count]
    return moved * (1 - share) + lines[first + 1 : first + 1 + count] * share if share else moved


def _find_step(own: Plane, beside: Mapping[View, Plane], disparity: Plane) -> Plane:
    """Returns what least squares on the gradient add to `disparity`."""
    from scipy import ndimage

    along, squares = np.zeros_like(own), np.zeros_like(own)
    for (down, right), luma in beside.items():
        axis = 0 if down else 1
        moved = warp_picture(pad_edges(luma, axis), disparity * np.float32(down or right), axis)
        slope = np.gradient(moved, axis=axis) if moved.shape[axis] > 1 else np.zeros_like(moved)
        slope *= down or right
        difference = own - moved
        weight = SOFT / (SOFT + np.square(difference))
        weight *= slope
        along += weight * difference
        squares += weight * slope
    along = ndimage.uniform_filter(along, PATCH, mode="nearest")
    squares = ndimage.uniform_filter(squares, PATCH, mode="nearest")
    squares += LEAST_SLOPE
    along /= squares
    step: Plane = np.clip(along, -FARTHEST, FARTHEST, out=along)
    return step


def _remove_outliers(plane: Plane) -> Plane:
    """Returns the median of each pixel and those beside it, along each axis in turn."""
    for axis in (0, 1):
        padded = np.pad(plane, [(1, 1) if side == axis else (0, 0) for side in range(2)], mode="edge")
        before, own, after = (padded.take(range(k, k + plane.shape[axis]), axis) for k in range(3))
        plane = np.maximum(np.minimum(before, own), np.minimum(np.maximum(before, own), after))
    return plane
