"""Whole-pixel disparities in a light field, by which views are shifted before a network searches for the rest.

Each tile of a view has its own shift, a multiple of `SHIFT_STEP`, because content at other depths moves differently.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, cast

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

MAXIMUM_DISPARITY = 18
"""Largest whole disparity that is searched for, pixels from one view to the next."""
UNSHIFTED_DISPARITY = 1
"""Up to this disparity views are not shifted, because networks find it themselves."""
SHIFT_STEP = 2
"""Shifts are multiples of this, so that little more than a pixel of the disparity is left to the network and a scene
has few different shifts, each of which costs a run of the network."""
MAXIMUM_RATIO = 0.8
"""A shift is used if it reduces the difference between views to at most this share."""
SHIFT_TILE = 8
"""Pixels along each side of a tile, which has one shift."""
SAMPLED_ROWS = 4
"""One in this many rows of a view is compared."""
MINIMUM_TILES = 6
"""Fewest tiles of a view for which a shift is used. Fewer are seldom right, and a run of the network costs more."""
OWN_VOTES = 2
"""A tile's votes for its own shift; each of the 8 surrounding tiles has one vote."""
STRIP_VALUES = 1 << 20
"""Most differences that are held at once."""
NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def measure_shifts(
    lumas: Mapping[View, Plane], wanted: Sequence[View], grid: tuple[int, int]
) -> list[NDArray[np.int64]]:
    """Measures the shift of each tile of each view of `wanted` in a grid of `grid` views, `(ceil(H / SHIFT_TILE),
    ceil(W / SHIFT_TILE))`. `lumas`: luma in [0, 1], `(H, W)`, of at least those views and their direct neighbours. A
    view's shifts don't depend on which others are wanted.

    A shift is the number of whole pixels by which content moves from one view to the next, rounded towards 0 to a
    multiple of `SHIFT_STEP`. It is 0 where that number is small or unclear. A shear of the light field removes it (Ng,
    SIGGRAPH 2005, equation 4.2). Only the direct neighbours, up to four, are compared.
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
    """Yields groups of up to `most` of the views `wanted` whose direct neighbours are in the same directions."""
    alike: dict[tuple[View, ...], list[View]] = {}
    for view in wanted:
        alike.setdefault(tuple(list_neighbours([view], grid)), []).append(view)
    for group in alike.values():
        for first in range(0, len(group), most):
            yield group[first : first + most]


def list_neighbours(group: Sequence[View], grid: tuple[int, int]) -> dict[View, list[View]]:
    """Lists, by direction, the direct neighbours of a `group` of `group_by_neighbours` in a grid of `grid` views."""
    found = {}
    for down, right in NEIGHBOURS:
        v, u = group[0][0] + down, group[0][1] + right
        if 0 <= v < grid[0] and 0 <= u < grid[1]:
            found[down, right] = [(row + down, col + right) for row, col in group]
    return found


def _choose_shifts(costs: NDArray[np.int32], largest: int) -> Iterator[NDArray[np.int64]]:
    """Yields the shifts `(R, C)` of each view, from the blurred costs `(n, 2*largest + 1, R, C)`."""
    order = np.array(sorted(range(-largest, largest + 1), key=abs))  # if costs are equal, the smallest is chosen
    best = order[costs[:, order + largest].argmin(axis=1)]
    near = costs[:, largest - UNSHIFTED_DISPARITY : largest + UNSHIFTED_DISPARITY + 1].min(axis=1)
    pays = (np.abs(best) > UNSHIFTED_DISPARITY) & (costs.min(axis=1) < MAXIMUM_RATIO * near)
    rounded = np.where(pays, best - np.fmod(best, SHIFT_STEP), 0)  # towards 0, so that reversed views are opposite
    for one in rounded:
        shifts = _vote(one)
        values, counts = np.unique(shifts, return_counts=True)
        yield np.where(np.isin(shifts, values[counts < MINIMUM_TILES]), 0, shifts)


def make_no_shifts(height: int, width: int) -> NDArray[np.int64]:
    """Returns shifts of 0, in the shape of `measure_shifts`, for the tiles of a view of `height x width` pixels."""
    return np.zeros((-(-height // SHIFT_TILE), -(-width // SHIFT_TILE)), np.int64)


def list_shifts(shifts: NDArray[np.int64], part: Span) -> list[int]:
    """Lists the different shifts that the tiles of a part of a view have."""
    rows, cols = (slice(side.start // SHIFT_TILE, -(-side.stop // SHIFT_TILE)) for side in part)
    return sorted(set(shifts[rows, cols].ravel().tolist()))


def select_shifted(shifts: NDArray[np.int64], shift: int, part: Span) -> NDArray[np.bool_]:
    """Returns a mask `(h, w)` that is true where the tiles of a part of a view have the shift `shift`."""
    rows, cols = (np.arange(side.start, side.stop) // SHIFT_TILE for side in part)
    return np.asarray((shifts == shift)[rows[:, None], cols])


def _compare_tiles(
    pictures: NDArray[np.uint8], neighbours: Mapping[View, NDArray[np.uint8]], largest: int
) -> NDArray[np.uint16]:
    """Sums absolute differences over each tile: `(n, 2*largest + 1, rows of tiles, columns of tiles)`.

    `pictures` are views and `neighbours` their neighbours by direction, all as luma in levels `(n, H, W)`. The
    neighbours are moved back by -largest to largest pixels. The sums are of whole levels and so don't depend on their
    order.
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
    """Moves rows by `-by` to `by`, `(n, 2*abs(by) + 1)`. Those that would leave `height` pixels are not moved, so that
    nothing beyond a view counts in favour of a shift.
    """
    moved = rows[:, None] + np.arange(-abs(by), abs(by) + 1) * (1 if by > 0 else -1)
    return np.where((moved >= 0) & (moved < height), moved, rows[:, None])


def _move_columns(levels: NDArray[np.uint8], by: int) -> NDArray[np.uint8]:
    """Moves the columns of `(..., W)` as `_move` moves rows: `(..., 2*abs(by) + 1, W)`."""
    most, width = abs(by), levels.shape[-1]
    padded = np.zeros((*levels.shape[:-1], width + 2 * most), np.uint8)
    padded[..., most:-most] = levels
    moved: NDArray[np.uint8] = sliding_window_view(padded, width, axis=-1).copy()
    is_outside = np.tri(most, dtype=np.bool_)
    np.copyto(moved[..., :most, :most], levels[..., None, :most], where=is_outside[::-1])
    np.copyto(moved[..., -most:, -most:], levels[..., None, -most:], where=is_outside[:, ::-1])
    return moved if by > 0 else moved[..., ::-1, :]


def _round_lumas(lumas: Sequence[Plane]) -> NDArray[np.uint8]:
    """Rounds luma in [0, 1] to whole 8-bit levels, `(n, H, W)`."""
    return (np.stack(lumas) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _blur_tiles(cost: NDArray[np.uint16]) -> NDArray[np.int32]:
    """Adds half of the tiles on each side to each tile of `(..., R, C)`, along rows and columns. The result is four
    times as large.
    """
    blurred = cost.astype(np.int32)
    for axis in (-2, -1):
        near = np.moveaxis(blurred, axis, 0)
        own = _add_beside(near)
        near += own
        near[0] += own[0]
        near[-1] += own[-1]
    return blurred


def _vote(shifts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Replaces each tile's shift `(R, C)` by the most frequent one among it and the surrounding tiles."""
    present = np.array(sorted(set(shifts.ravel().tolist())))  # not with np.unique, which imports np.ma
    if len(present) == 1:
        return shifts
    is_own = shifts == present[:, None, None]
    votes = is_own.astype(np.int32)
    for axis in (1, 2):
        _add_beside(np.moveaxis(votes, axis, 0))
    votes += (OWN_VOTES - 1) * is_own
    return np.asarray(present[votes.argmax(axis=0)])


def _add_beside(tiles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Adds to each of `tiles` its two neighbours along the first axis, in place. Returns the original values."""
    own = tiles.copy("K")  # not transposed in memory
    tiles[1:] += own[:-1]
    tiles[:-1] += own[1:]
    return own


def find_margin(shift: int) -> int:
    """Returns by how many pixels a shift of `shift` pixels per view can move a view of a window."""
    return abs(shift) * (WINDOW_SIDE - 1)


def crop_luma(picture: Pixels, part: Span | None = None, margin: int = 0) -> Plane:
    """Returns luma in [0, 1] of a picture `(H, W, C)`, or of a part of it, cropped as by `crop_with_margin`."""
    picture = picture if part is None else crop_with_margin(picture, part, margin)
    luma = compute_luma(picture, np.iinfo(picture.dtype).max)
    return np.minimum(luma, 1, out=luma)


def crop_with_margin(picture: Pixels, part: Span, margin: int) -> Pixels:
    """Crops a part of a picture `(H, W, C)` with a margin on each side. Beyond the picture its edge pixels are
    repeated.
    """
    inside, beyond = [], []
    for side, length in zip(part, picture.shape[:2], strict=True):
        start, stop = side.start - margin, side.stop + margin
        inside.append(slice(max(0, start), min(length, stop)))
        beyond.append((max(0, -start), max(0, stop - length)))
    cropped: Pixels = picture[inside[0], inside[1]]
    if not any(map(any, beyond)):
        return cropped
    return cast("Pixels", np.pad(cropped, (*beyond, (0, 0)), mode="edge"))


def shift_part(plane: NDArray[Value], shift: int, offset: tuple[int, int], margin: int) -> NDArray[Value]:
    """Shifts a part `(H, W)` by `shift` pixels for each view of its `offset` (down, right), and removes its `margin`,
    which is at least that of `find_margin`.
    """
    rows, cols = (
        slice(margin + shift * step, length - margin + shift * step)
        for step, length in zip(offset, plane.shape, strict=True)
    )
    return plane[rows, cols]


def convert_to_float(picture: Pixels) -> NDArray[np.float32]:
    """Converts the picture's values to [0, 1]."""
    return picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)
