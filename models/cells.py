"""A picture in cells of 8x8 pixels, and how much of each a cubic can't follow: its edge score.

Networks add to interpolation what a cubic can't follow, so the score is the mean square of fourth differences.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float32]

Depth = TypeVar("Depth", np.uint8, np.uint16)

CELL = 8
"""Side of a cell, input pixels."""
REACH = 2
"""Pixels to each side that a fourth difference looks at."""
BAND = 1 << 17
"""Most pixels that are scored at once: as float they stay in the cache."""


def edge_scores(picture: NDArray[Depth]) -> Floats:
    """Of each cell of `(H, W, C)`, 8 or 16 bit: the mean square of its fourth differences along rows and columns, in
    8-bit levels, `(ceil(H / CELL), ceil(W / CELL))`. The last cells of a row or column may be cut off.
    """
    height, width, channels = picture.shape
    unit = np.float32(255 / np.iinfo(picture.dtype).max)
    padded = np.pad(picture, ((REACH, REACH), (REACH, REACH), (0, 0)), mode="edge").reshape(height + 2 * REACH, -1)
    inner = slice(REACH * channels, -REACH * channels)
    band = max(1, BAND // width // CELL) * CELL
    rows, cols = -(-height // CELL), -(-width // CELL)
    sums = np.empty((rows, cols), np.float32)
    for top in range(0, height, band):
        bottom = min(height, top + band)
        part = padded[top : bottom + 2 * REACH].astype(np.float32) * unit
        squares = np.square(_second(_second(part, 1), 1)[:, inner])
        squares += np.square(_second(_second(part[REACH:-REACH], channels, axis=1), channels, axis=1))
        along = np.add.reduceat(squares, np.arange(0, bottom - top, CELL), axis=0)
        first = top // CELL
        sums[first : first + len(along)] = np.add.reduceat(along, np.arange(0, width, CELL) * channels, axis=1)
    return np.asarray(sums / (areas(height, width).astype(np.float32) * channels))


def _second(values: Floats, step: int, axis: int = 0) -> Floats:
    """Second differences along an axis, `2 * step` fewer."""
    if axis:
        return values[:, : -2 * step] + values[:, 2 * step :] - 2 * values[:, step:-step]
    return values[: -2 * step] + values[2 * step :] - 2 * values[step:-step]


def areas(height: int, width: int) -> NDArray[np.int64]:
    """Pixels of each cell."""
    rows, cols = (np.minimum(CELL, side - np.arange(0, side, CELL)) for side in (height, width))
    return np.multiply.outer(rows, cols)
