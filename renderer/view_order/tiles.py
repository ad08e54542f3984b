"""Finds textured tiles of a light field's centre view, and cuts the same places from other views."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ciir.renderer.view_order.evidence import REACH, TILE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.view_order.evidence import Plane

    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

    class Views(Protocol):
        """Views `(H, W, C)` by (v, u): an array `(V, U, H, W, C)`, or views that are decoded when used."""

        @property
        def shape(self) -> tuple[int, ...]:
            """`(V, U, H, W, C)`."""

        def __getitem__(self, view: tuple[int, int], /) -> Pixels:
            """Returns view (v, u)."""


TILES = 24
"""Most tiles of a sweep."""
LARGEST_SIDE = 640
"""Only this many pixels along each side, in the middle of the views, are used."""
LEAST_TEXTURE = 1.5 / 255
"""Smallest root mean square of a tile's gradient in its weakest direction, in [0, 1] for each pixel."""


def crop_middle(views: Views) -> tuple[slice, slice]:
    """Returns the rows and columns of each view that are used."""
    rows, cols = (slice(max(0, (side - LARGEST_SIDE) // 2), (side + LARGEST_SIDE) // 2) for side in views.shape[2:4])
    return rows, cols


def cut_tiles(
    view: Pixels, places: Sequence[tuple[int, int]], factor: int = 1, *, margin: int = 0, unused: int
) -> Plane:
    """Returns the luma of the tiles of a view at `places`, with `margin` more pixels on each side, all downscaled by
    `factor`: `(T, TILE + 2*margin, TILE + 2*margin)`. `unused`: from `count_unused_bits`.
    """
    parts = [[slice(factor * (at - margin), factor * (at + TILE + margin)) for at in place] for place in places]
    pictures: NDArray[Any] = np.stack([view[rows, cols] for rows, cols in parts])
    return make_luma(pictures, factor, unused)


def find_tiles(luma: Plane) -> list[tuple[int, int]]:
    """Returns tops and lefts of up to `TILES` tiles with most texture in every direction, half a tile apart or more."""
    half = TILE // 2
    down, right = ((length - 2 * REACH) // half for length in luma.shape)
    if min(down, right) < 2:
        return []
    part = luma[REACH - 1 : REACH + down * half + 1, REACH - 1 : REACH + right * half + 1]
    across, along = part[1:-1, 2:] - part[1:-1, :-2], part[2:, 1:-1] - part[:-2, 1:-1]

    def add_up(products: Plane) -> Plane:
        blocks = products.reshape(down, half, right, half).sum(axis=(1, 3))
        total: Plane = blocks[1:, 1:] + blocks[:-1, 1:] + blocks[1:, :-1] + blocks[:-1, :-1]
        return total

    xx, yy, xy = add_up(across * across), add_up(along * along), add_up(across * along)
    weakest = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)  # the smaller eigenvalue of the structure tensor
    least = (2 * LEAST_TEXTURE * TILE) ** 2
    places: list[tuple[int, int]] = []
    is_free = np.ones(weakest.shape, bool)
    for row, column in zip(*np.unravel_index(np.argsort(-weakest, axis=None), weakest.shape), strict=True):
        if len(places) == TILES or weakest[row, column] < least:
            break
        if is_free[row, column]:
            is_free[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2] = False
            places.append((REACH + int(row) * half, REACH + int(column) * half))
    return places


def make_luma(pictures: Pixels, factor: int, unused: int) -> Plane:
    """Returns the mean of the colours of `(..., H, W, C)` and of each `factor x factor` pixels, in [0, 1] of the range
    without the `unused` upper bits.
    """
    *count, height, width, channels = pictures.shape
    rows, cols, colours = height // factor, width // factor, channels - (channels in (2, 4))
    values = pictures[..., : rows * factor, : cols * factor, :colours]
    if factor > 1:
        values = values.reshape(*count, rows, factor, cols * factor * colours).sum(axis=-2, dtype=np.uint32)
    values = values.reshape(*count, rows, cols, factor * colours)
    weight = 2**unused / (np.iinfo(pictures.dtype).max * colours * factor**2)
    luma: Plane = values.astype(np.float32) @ np.full(factor * colours, weight, np.float32)
    return luma
