"""Whole-pixel disparities in a light field, by which views are shifted before a network searches for the rest.

Each tile of a view has its own shift, a multiple of `SHIFT_STEP`: content at other depths moves differently.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ciir.models.light_field.network import compute_luma
from ciir.models.light_field.windows import WINDOW_SIDE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ciir.models.light_field.windows import View
    from ciir.models.tiles import Span

    Plane = NDArray[np.float32]
    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

Value = TypeVar("Value", np.float32, np.bool_)

MAXIMUM_DISPARITY = 12
"""Largest whole disparity that is searched for, pixels from one view to the next."""
UNSHIFTED_DISPARITY = 1
"""Up to this views are not shifted: networks search 2 pixels to each side themselves."""
SHIFT_STEP = 3
"""Shifts are multiples of this, so that at most one pixel of the disparity is left to the network, and a scene has few
different shifts: each is a run of the network."""
MAXIMUM_RATIO = 0.8
"""A shift is used where it reduces the difference between views to at most this share."""
SHIFT_TILE = 8
"""Pixels along each side of the tiles that each have one shift."""
SAMPLED_ROWS = 4
"""One of so many rows of a view is compared."""
MINIMUM_TILES = 6
"""Fewest tiles of a view that a shift is used for: fewer are seldom right, and a run of the network costs more."""
OWN_VOTES = 2
"""Votes of a tile for its own shift, where each of the 8 tiles around it has one."""
STRIP_VALUES = 1 << 20
"""Differences that are held at once."""
NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def measure_shifts(views: Mapping[View, Pixels], view: View, grid: tuple[int, int]) -> NDArray[np.int64]:
    """The shift for each tile of a view in a grid of `grid` views, `(ceil(H / SHIFT_TILE), ceil(W / SHIFT_TILE))`.

    It is the number of whole pixels by which content moves from one view to the next, rounded to a multiple of
    `SHIFT_STEP`; 0 where it is small or unclear. A shear of the light field removes it (Ng, SIGGRAPH 2005, equation
    4.2). Only the direct neighbours, up to four, are compared.
    """
    height, width, _ = views[view].shape
    largest = min(MAXIMUM_DISPARITY, (min(height, width) - 1) // 4)
    if largest <= UNSHIFTED_DISPARITY:
        return np.zeros((-(-height // SHIFT_TILE), -(-width // SHIFT_TILE)), np.int64)
    places = ((offset, (view[0] + offset[0], view[1] + offset[1])) for offset in NEIGHBOURS)
    neighbours = {offset: views[v, u] for offset, (v, u) in places if 0 <= v < grid[0] and 0 <= u < grid[1]}
    cost = _blur_tiles(_compare_tiles(views[view], neighbours, largest))
    order = np.array(sorted(range(-largest, largest + 1), key=abs))  # of equal ones the smallest is taken
    best = order[cost[order + largest].argmin(axis=0)]
    near = cost[largest - UNSHIFTED_DISPARITY : largest + UNSHIFTED_DISPARITY + 1].min(axis=0)
    pays = (np.abs(best) > UNSHIFTED_DISPARITY) & (cost.min(axis=0) < MAXIMUM_RATIO * near)
    shifts = _vote(np.where(pays, (best + SHIFT_STEP // 2) // SHIFT_STEP * SHIFT_STEP, 0))
    values, counts = np.unique(shifts, return_counts=True)
    return np.where(np.isin(shifts, values[counts < MINIMUM_TILES]), 0, shifts)


def select_shifted(shifts: NDArray[np.int64], shift: int, part: Span) -> NDArray[np.bool_]:
    """`(h, w)`: where in a part of a view its tiles have one of their `shifts`."""
    rows, cols = (np.arange(side.start, side.stop) // SHIFT_TILE for side in part)
    return np.asarray((shifts == shift)[rows[:, None], cols])


def _compare_tiles(view: Pixels, neighbours: Mapping[tuple[int, int], Pixels], largest: int) -> NDArray[np.int64]:
    """Sums of absolute differences between a view and its neighbours, moved back by -largest to largest pixels, by
    tile: `(2*largest + 1, rows of tiles, columns of tiles)`.

    They are sums of whole 8-bit levels of luma and so don't depend on their order.
    """
    height, width, _ = view.shape
    down, across, count = -(-height // SHIFT_TILE), -(-width // SHIFT_TILE), 2 * largest + 1
    cols, in_tile = np.minimum(np.arange(across * SHIFT_TILE), width - 1), SHIFT_TILE // SAMPLED_ROWS
    result = np.empty((count, down, across), np.int64)
    step = max(1, STRIP_VALUES // (count * in_tile * len(cols)))
    for first in range(0, down, step):
        last = min(first + step, down)
        rows = np.arange(first * SHIFT_TILE + SAMPLED_ROWS // 2, last * SHIFT_TILE, SAMPLED_ROWS)
        rows = np.minimum(rows, height - 1)
        here = _crop_levels(view, rows)[:, None, cols]
        total = np.zeros((len(rows), count, len(cols)), np.uint16)  # a tile's sum has 16 bits too
        for (by_row, by_col), other in neighbours.items():
            if by_row:
                moved = _move(rows, by_row * largest, height)
                top = int(moved.min())
                there = _crop_levels(other, slice(top, int(moved.max()) + 1))[:, cols][moved.T - top]
            else:
                there = _crop_levels(other, rows)[:, _move(cols, by_col * largest, width)]
            total += np.maximum(there, here) - np.minimum(there, here)
        sums = total.reshape(last - first, in_tile, count, -1).sum(axis=1, dtype=np.uint16)
        sums = sum((sums[..., col::SHIFT_TILE] for col in range(1, SHIFT_TILE)), start=sums[..., ::SHIFT_TILE])
        result[:, first:last] = sums.transpose(1, 0, 2)
    return result


def _move(places: NDArray[np.int64], by: int, length: int) -> NDArray[np.int64]:
    """Rows or columns moved by `-by` to `by`, `(2*abs(by) + 1, n)`; not moved where they would leave `length` pixels,
    so that nothing beyond a view speaks for a shift.
    """
    moved = places + np.linspace(-by, by, 2 * abs(by) + 1, dtype=np.int64)[:, None]
    return np.where((moved >= 0) & (moved < length), moved, places)


def _crop_levels(picture: Pixels, rows: NDArray[np.int64] | slice) -> NDArray[np.uint8]:
    """Luma of some rows of a picture `(H, W, C)` in whole 8-bit levels, `(rows, W)`."""
    return (crop_luma(picture[rows]) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _blur_tiles(cost: NDArray[np.int64]) -> NDArray[np.int64]:
    """`(shifts, R, C)` with a half of the tiles to each side added along rows and columns, times four."""
    for axis in (1, 2):
        width = [(1, 1) if axis == other else (0, 0) for other in range(3)]
        padded, count = np.pad(cost, width, mode="edge"), cost.shape[axis]
        cost = padded.take(range(count), axis) + 2 * cost + padded.take(range(2, count + 2), axis)
    return cost


def _vote(shifts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each tile's shift `(R, C)` replaced by the most frequent of it and the tiles around it."""
    present = np.array(sorted(set(shifts.ravel().tolist())))  # not by np.unique, which imports np.ma
    if len(present) == 1:
        return shifts
    is_own = (shifts == present[:, None, None]).astype(np.int64)
    padded = np.pad(is_own, ((0, 0), (1, 1), (1, 1)))
    votes = sliding_window_view(padded, (3, 3), axis=(1, 2)).sum(axis=(3, 4)) + (OWN_VOTES - 1) * is_own
    return np.asarray(present[votes.argmax(axis=0)])


def crop_luma(picture: Pixels, part: Span | None = None, shift: int = 0) -> Plane:
    """Luma in [0, 1] of a picture `(H, W, C)`, or of a part of it as `crop_with_margin` takes it."""
    picture = picture if part is None else crop_with_margin(picture, part, shift)
    return np.minimum(compute_luma(picture, np.iinfo(picture.dtype).max), 1)


def crop_with_margin(picture: Pixels, part: Span, shift: int) -> Pixels:
    """A part of a picture `(H, W, C)` with the margin that a shift of `shift` pixels per view can move it by; beyond
    the picture its edge pixels are repeated.
    """
    if not shift:
        return picture[part]
    margin = abs(shift) * (WINDOW_SIDE - 1)
    rows, cols = (
        np.clip(np.arange(side.start - margin, side.stop + margin), 0, length - 1)
        for side, length in zip(part, picture.shape[:2], strict=True)
    )
    cropped: Pixels = picture[rows[:, None], cols]
    return cropped


def shift_part(plane: NDArray[Value], shift: int, offset: tuple[int, int]) -> NDArray[Value]:
    """A part `(H, W)` without its margin, shifted by `shift` pixels for each view of its `offset` (down, right)."""
    margin = abs(shift) * (WINDOW_SIDE - 1)
    rows, cols = (
        slice(margin + shift * step, length - margin + shift * step)
        for step, length in zip(offset, plane.shape, strict=True)
    )
    return plane[rows, cols]


def convert_to_float(picture: Pixels) -> NDArray[np.float32]:
    """The picture's values in [0, 1]."""
    return picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)
