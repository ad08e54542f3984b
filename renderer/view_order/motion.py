"""Measures how far content moves from one view of a light field to the next, from textured tiles of the centre view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_unused_bits
from ciir.renderer.view_order.evidence import AROUND, REACH, correlate, find_shifts
from ciir.renderer.view_order.tiles import crop_middle, cut_tiles, find_tiles, make_luma
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from ciir.renderer.view_order.tiles import Views

STEP = 4
"""Steps from the centre view to those that it is compared with: shifts are then known to an eighth of a pixel."""
SHARE = 90
"""Percentage of the tiles that move no further than the returned value."""
LEAST_TILES, LEAST_CORRELATION = 8, 0.7
"""Number of tiles that must be found again, with this correlation. Four tiles of a boot on a black background misled:
the rest moved more."""


def measure_motion(views: Views) -> float | None:
    """Returns how far, in pixels, nine tenths of the textured tiles of `views`, `(V, U, H, W, C)` in order, move at
    most from one view to the next, in either direction.

    A tile that is not found again counts as one that moves too far. Returns None if too few are found, and in grids of
    less than 9x9 views. Looks at the centre view and eight views around it.
    """
    v, u = center_view(*views.shape[:2])
    if min(v, u, views.shape[0] - 1 - v, views.shape[1] - 1 - u) < STEP:
        return None
    crop = crop_middle(views)
    center = views[v, u][crop]
    unused = count_unused_bits(center)
    places = find_tiles(make_luma(center, 1, unused))
    if len(places) < LEAST_TILES:
        return None
    around = [views[v + STEP * down, u + STEP * right][crop] for down, right in AROUND]
    pictures = np.stack([cut_tiles(view, places, margin=REACH, unused=unused) for view in around], axis=1)
    shifts, correlation = find_shifts(correlate(cut_tiles(center, places, unused=unused), pictures))
    is_found = correlation >= LEAST_CORRELATION
    if np.count_nonzero(is_found) < LEAST_TILES:
        return None
    return float(np.percentile(np.where(is_found, np.abs(shifts), REACH), SHARE)) / STEP
