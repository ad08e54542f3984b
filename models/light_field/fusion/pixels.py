"""Takes the mean of an upscaled view and those around it, at the places that show the same content."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.fusion.warping import pad_edges, warp_picture

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.models.light_field.disparities.shifts import Plane

DEVIATION = 0.18
"""Difference, as the root of its mean square over a patch, at which a view's weight is 1/e, in units of contrast."""
OWN_WEIGHT = np.float32(1.5)
"""Weight of the view itself; that of another one is at most 1."""
PATCH = 5
"""Side of that patch, in pixels of the upscaled views."""

AROUND = 15
"""Side of the square over which views are brought to the same brightness, in the same pixels."""
MARGIN = PATCH // 2 + AROUND // 2
"""Rows on each side of a strip that the filters need."""
STRIP_ROWS = 64
"""Rows that are processed at once, so that they stay in the processor's cache."""


def fuse_lumas(own: Plane, beside: Mapping[int, Plane], disparity: Plane, axis: int) -> Plane:
    """Returns the mean of `own` and the views `beside` it in its column (`axis` 0) or row (1), by offset: luma in units
    of the view's contrast, `(k*H, k*W)`.

    `disparity`: by how many pixels of `(H, W)` content moves towards larger coordinates from one view to the next. A
    view that shows other content at a pixel, because something hides it there, hardly counts: its weight falls with the
    mean squared difference around the pixel, as in non-local means (Buades et al., CVPR 2005). Differences that are
    the same all around a pixel don't count and don't change the result: lenses and cameras differ in brightness.
    """
    from scipy import ndimage  # imported here because most jobs don't need it

    scale = len(own) // len(disparity)
    moved = scale * enlarge(disparity, scale)
    result = np.empty_like(own)
    padded = {offset: pad_edges(luma, axis) for offset, luma in beside.items()}
    for top in range(0, len(own), STRIP_ROWS):
        first = max(0, top - MARGIN)
        some = slice(first, top + STRIP_ROWS + MARGIN)
        here, by = own[some], moved[some]
        total, weights = OWN_WEIGHT * here, np.full_like(here, OWN_WEIGHT)
        for offset, luma in padded.items():
            warped = warp_picture(luma, by * np.float32(offset), axis, first_row=first)
            difference = here - warped
            even = ndimage.uniform_filter(difference, AROUND, mode="nearest")
            warped += even
            difference -= even
            weight = ndimage.uniform_filter(np.square(difference), PATCH, mode="nearest")
            weight *= np.float32(-1 / DEVIATION**2)
            np.minimum(weight, 0, out=weight)  # the filter's sums can fall below zero by rounding
            np.exp(weight, out=weight)
            weights += weight
            weight *= warped
            total += weight
        total /= weights
        result[top : top + STRIP_ROWS] = total[top - first :][:STRIP_ROWS]
    return result


def enlarge(plane: Plane, scale: int) -> Plane:
    """Returns `(H, W)` at `(scale*H, scale*W)` by linear interpolation; beyond the border the edge is repeated."""
    for axis in (0, 1):
        length = plane.shape[axis]
        place = np.clip((np.arange(scale * length, dtype=np.float32) + 0.5) / scale - 0.5, 0, length - 1)
        before = np.floor(place).astype(np.intp)
        share = (place - before).astype(np.float32)
        share = share[:, None] if axis == 0 else share
        after = np.minimum(before + 1, length - 1)
        plane = plane.take(before, axis) * (1 - share) + plane.take(after, axis) * share
    return plane
