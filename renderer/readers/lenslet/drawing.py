"""Draws a lens grid over its picture, to check whether it fits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_unused_camera_bits, raise_levels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.lenslet.grid import LensGrid
    from ciir.renderer.readers.pictures import Pixels

BORDER, CENTER = (255, 64, 0), (0, 255, 255)
_STRIP = 1 << 20  # pixels drawn at a time


def draw_grid(picture: Pixels, grid: LensGrid) -> NDArray[np.uint8]:
    """Returns `picture`, `(H, W, C)`, as `(H, W, 3)` uint8 with half-transparent borders between lenses, and their
    centres.
    """
    height, width = picture.shape[:2]
    channels = [0, 1, 2] if picture.shape[2] >= 3 else [0, 0, 0]
    drawn: NDArray[np.uint8] = picture[..., channels].astype(np.uint8)
    if picture.dtype == np.uint16:
        raised = raise_levels(picture, count_unused_camera_bits(picture))
        drawn = (raised[..., channels] >> 8).astype(np.uint8)
    rows = max(_STRIP // width, 1)
    for top in range(0, height, rows):
        points = np.moveaxis(np.mgrid[top : min(top + rows, height) + 1, 0 : width + 1], 0, -1)
        i, j = grid.find_nearest(points)
        is_border = np.zeros((len(points) - 1, width), bool)
        for lens in (i, j):
            is_border |= (lens[:-1, :-1] != lens[1:, :-1]) | (lens[:-1, :-1] != lens[:-1, 1:])
        strip = drawn[top : top + len(is_border)]
        strip[is_border] = (strip[is_border].astype(np.uint16) + BORDER) // 2
        centers = np.rint(grid.find_centers(i, j)[:-1, :-1]).astype(np.int64)
        strip[(centers == points[:-1, :-1]).all(axis=-1)] = CENTER
    return drawn
