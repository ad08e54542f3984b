"""Warps pictures: moves the content of each pixel by its own distance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models.single.interpolation import KEYS_A

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Plane

TAPS = (-1, 0, 1, 2)
"""Pixels that cubic convolution combines, relative to the one before the place."""


def warp_picture(picture: Plane, down: Plane | None, right: Plane | None, *, first_row: int = 0) -> Plane:
    """Returns `picture` `(H, W)` at the pixels of some of its rows, from `first_row` on, each moved by `down` and
    `right` pixels, `(h, W)`, by cubic convolution (Keys, IEEE TASSP 29(6), 1981). None: nothing moves along that axis.
    Beyond the border its edge pixels are repeated.
    """
    height, width = picture.shape
    shape = next(moved.shape for moved in (down, right) if moved is not None)
    place = np.arange(first_row, first_row + shape[0], dtype=np.float32)
    rows = _find_taps(place[:, None], down, height)
    cols = _find_taps(np.arange(width, dtype=np.float32), right, width)
    flat = picture.ravel()
    result = np.zeros(shape, np.float32)
    for row, row_weight in rows:
        line, inner = row * width, np.zeros(shape, np.float32)
        for col, col_weight in cols:
            part = flat.take(line + col)
            inner += part if col_weight is None else np.multiply(part, col_weight, out=part)
        result += inner if row_weight is None else np.multiply(inner, row_weight, out=inner)
    return result


def _find_taps(place: Plane, moved: Plane | None, length: int) -> list[tuple[NDArray[np.int32], Plane | None]]:
    """Returns the pixels along one axis that are combined, and their weights."""
    if moved is None:
        return [(place.astype(np.int32), None)]
    place = np.clip(place + moved, -1, length)
    before = np.floor(place)
    weights = weigh_taps(place - before)
    first = before.astype(np.int32)
    return [(np.clip(first + tap, 0, length - 1), weight) for tap, weight in zip(TAPS, weights, strict=True)]


def weigh_taps(share: Plane) -> list[Plane]:
    """Returns the weights of `TAPS` at a place that is `share` of a pixel after the pixel before it: Keys' kernel."""
    square = np.square(share)
    cube = square * share
    a = np.float32(KEYS_A)
    return [
        a * (cube - 2 * square + share),
        (a + 2) * cube - (a + 3) * square + 1,
        (2 * a + 3) * square - (a + 2) * cube - a * share,
        a * (square - cube),
    ]
