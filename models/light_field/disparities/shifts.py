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
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.windows import View
    from ciir.models.tiles import Span

    Plane = NDArray[np.float32]
    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

Value = TypeVar("Value", np.float32, np.bool_)

MAXIMUM_DISPARITY = 12
"""Largest whole disparity that is searched for, pixels from one view to the next."""
UNSHIFTED_DISPARITY = 1
"""Up to this views are not shifted: networks find the rest themselves."""
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


def measure_shifts(
    lumas: Mapping[View, Plane], wanted: Sequence[View], grid: tuple[int, int]
) -> list[NDArray[np.int64]]:
    """The shift for each tile of each view of `wanted` in a grid of `grid` views, `(ceil(H / SHIFT_TILE),
    ceil(W / SHIFT_TILE))`. `lumas`: luma in [0, 1], `(H, W)`, of at least those views and their direct neighbours. A
    view's shifts don't depend on which others are wanted.

    A shift is the number of whole pixels by which content moves from one view to the next, rounded to a multiple of
    `SHIFT_STEP`; 0 where it is small or unclear. A shear of the light field removes it (Ng, SIGGRAPH 2005, equation
    4.2). Only the direct neighbours, up to four, are compared.
    """
    height, width = lumas[wanted[0]].shape
    largest = min(MAXIMUM_DISPARITY, (min(height, width) - 1) // 4)
    found = {view: make_no_shifts(height, width) for view in wanted}
    if largest > UNSHIFTED_DISPARITY:
        at_once = max(1, STRIP_VALUES // ((2 * largest + 1) * height * width // SAMPLED_ROWS))
        for group in group_by_neighbours(wanted, grid, at_once):
            neighbours = list_neighbours(group, grid)
            others = {offset: _round_lumas([lumas[view] for view in some]) for offset, some in neighbours.items()}
            costs = _blur_tiles(_compare_tiles(_round_lumas([lumas[view] for view in group]), others, largest))
            found.update(zip(group, _choose_shifts(costs, largest), strict=True))
    return [found[view] for view in wanted]


def group_by_neighbours(wanted: Sequence[View], grid: tuple[int, int], most: int) -> Iterator[list[View]]:
    """Groups of up to `most` of the views `wanted` whose direct neighbours are in the same directions."""
    alike: dict[tuple[View, ...], list[View]] = {}
    for view in wanted:
        alike.setdefault(tuple(list_neighbours([view], grid)), []).append(view)
    for group in alike.values():
        for first in range(0, len(group), most):
            yield group[first : first + most]


def list_neighbours(group: Sequence[View], grid: tuple[int, int]) -> dict[View, list[View]]:
    """The direct neighbours in a grid of `grid` views of those of a `group` of `group_by_neighbours`, by direction."""
    found = {}
    for down, right in NEIGHBOURS:
        v, u = group[0][0] + down, group[0][1] + right
        if 0 <= v < grid[0] and 0 <= u < grid[1]:
            found[down, right] = [(row + down, col + right) for row, col in group]
    return found


def _choose_shifts(costs: NDArray[np.int32], largest: int) -> Iterator[NDArray[np.int64]]:
    """From the blurred costs `(n, 2*largest + 1, R, C)` the shifts `(R, C)` of each view."""
    order = np.array(sorted(range(-largest, largest + 1), key=abs))  # of equal ones the smallest is taken
    best = order[costs[:, order + largest].argmin(axis=1)]
    near = costs[:, largest - UNSHIFTED_DISPARITY : largest + UNSHIFTED_DISPARITY + 1].min(axis=1)
    pays = (np.abs(best) > UNSHIFTED_DISPARITY) & (costs.min(axis=1) < MAXIMUM_RATIO * near)
    rounded = np.where(pays, (best + SHIFT_STEP // 2) // SHIFT_STEP * SHIFT_STEP, 0)
    for one in rounded:
        shifts = _vote(one)
        values, counts = np.unique(shifts, return_counts=True)
        yield np.where(np.isin(shifts, values[counts < MINIMUM_TILES]), 0, shifts)


def make_no_shifts(height: int, width: int) -> NDArray[np.int64]:
    """Shifts of 0, as of `measure_shifts`, for the tiles of a view of so many pixels."""
    return np.zeros((-(-height // SHIFT_TILE), -(-width // SHIFT_TILE)), np.int64)


def select_shifted(shifts: NDArray[np.int64], shift: int, part: Span) -> NDArray[np.bool_]:
    """`(h, w)`: where in a part of a view its tiles have one of their `shifts`."""
    rows, cols = (np.arange(side.start, side.stop) // SHIFT_TILE for side in part)
    return np.asarray((shifts == shift)[rows[:, None], cols])


def _compare_tiles(
    pictures: NDArray[np.uint8], neighbours: Mapping[View, NDArray[np.uint8]], largest: int
) -> NDArray[np.uint16]:
    """Sums of absolute differences between views and their neighbours by direction, all luma in levels `(n, H, W)`,
    moved back by -largest to largest pixels, by tile: `(n, 2*largest + 1, rows of tiles, columns of tiles)`.

    They are sums of whole levels and so don't depend on their order.
    """
    views, height, width = pictures.shape
    down, across, count = -(-height // SHIFT_TILE), -(-width // SHIFT_TILE), 2 * largest + 1
    in_tile = SHIFT_TILE // SAMPLED_ROWS
    result = np.empty((views, count, down, across), np.uint16)  # which a tile's sum fits
    step = max(1, STRIP_VALUES // (views * count * in_tile * width))
    for first in range(0, down, step):
        last = min(first + step, down)
        rows = np.arange(first * SHIFT_TILE + SAMPLED_ROWS // 2, last * SHIFT_TILE, SAMPLED_ROWS)
        rows = np.minimum(rows, height - 1)
        here = pictures[:, rows, None]
        total = np.zeros((views, len(rows), count, across * SHIFT_TILE // 2), np.uint16)  # of two columns each
        differences = np.empty((views, len(rows), count, across * SHIFT_TILE), np.uint8)
        for (by_row, by_col), others in neighbours.items():
            if by_row:
                there = others[:, _move(rows, by_row * largest, height)]
            else:
                there = _move_columns(others[:, rows], by_col * largest)
            np.subtract(np.maximum(there, here), np.minimum(there, here), out=differences[..., :width])
            differences[..., width:] = differences[..., width - 1 : width]
            pairs = differences.view(np.uint16)
            total += (pairs & 255) + (pairs >> 8)
        tiles = total.reshape(views, last - first, in_tile, count, across, SHIFT_TILE // 2)
        parts = [tiles[:, :, row, ..., col] for row in range(in_tile) for col in range(SHIFT_TILE // 2)]
        result[:, :, first:last] = sum(parts[1:], start=parts[0]).transpose(0, 2, 1, 3)
    return result


def _move(rows: NDArray[np.int64], by: int, height: int) -> NDArray[np.int64]:
    """Rows moved by `-by` to `by`, `(n, 2*abs(by) + 1)`; not moved where they would leave `height` pixels, so that
    nothing beyond a view speaks for a shift.
    """
    moved = rows[:, None] + np.arange(-abs(by), abs(by) + 1) * (1 if by > 0 else -1)
    return np.where((moved >= 0) & (moved < height), moved, rows[:, None])


def _move_columns(levels: NDArray[np.uint8], by: int) -> NDArray[np.uint8]:
    """The columns of `(..., W)` moved as `_move` does rows, `(..., 2*abs(by) + 1, W)`."""
    most, width = abs(by), levels.shape[-1]
    padded = np.zeros((*levels.shape[:-1], width + 2 * most), np.uint8)
    padded[..., most:-most] = levels
    moved: NDArray[np.uint8] = sliding_window_view(padded, width, axis=-1).copy()
    is_outside = np.tri(most, dtype=np.bool_)
    np.copyto(moved[..., :most, :most], levels[..., None, :most], where=is_outside[::-1])
    np.copyto(moved[..., -most:, -most:], levels[..., None, -most:], where=is_outside[:, ::-1])
    return moved if by > 0 else moved[..., ::-1, :]


def _round_lumas(lumas: Sequence[Plane]) -> NDArray[np.uint8]:
    """Luma in [0, 1] to whole 8-bit levels, `(n, H, W)`."""
    return (np.stack(lumas) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _blur_tiles(cost: NDArray[np.uint16]) -> NDArray[np.int32]:
    """`(..., R, C)` with a half of the tiles to each side added along rows and columns, times four."""
    blurred = cost.astype(np.int32)
    for axis in (-2, -1):
        near = np.moveaxis(blurred, axis, 0)
        own = _add_beside(near)
        near += own
        near[0] += own[0]
        near[-1] += own[-1]
    return blurred


def _vote(shifts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each tile's shift `(R, C)` replaced by the most frequent of it and the tiles around it."""
    present = np.array(sorted(set(shifts.ravel().tolist())))  # not by np.unique, which imports np.ma
    if len(present) == 1:
        return shifts
    is_own = shifts == present[:, None, None]
    votes = is_own.astype(np.int32)
    for axis in (1, 2):
        _add_beside(np.moveaxis(votes, axis, 0))
    votes += (OWN_VOTES - 1) * is_own
    return np.asarray(present[votes.argmax(axis=0)])


def _add_beside(tiles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Adds to each of `tiles` those before and behind it along the first axis; returns what they were."""
    own = tiles.copy("K")  # not transposed in memory
    tiles[1:] += own[:-1]
    tiles[:-1] += own[1:]
    return own


def crop_luma(picture: Pixels, part: Span | None = None, shift: int = 0) -> Plane:
    """Luma in [0, 1] of a picture `(H, W, C)`, or of a part of it as `crop_with_margin` takes it."""
    picture = picture if part is None else crop_with_margin(picture, part, shift)
    luma = compute_luma(picture, np.iinfo(picture.dtype).max)
    return np.minimum(luma, 1, out=luma)


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
