"""Ranges of the disparities in a light field's views, over which a network's planes are spread, and how far views are
from where they should be.

Both are measured on the textured tiles of a view. Each is compared with the view's direct neighbours, starting from the
best of three whole disparities and refined to a fraction of a pixel by least squares on its gradient (Lucas and Kanade,
IJCAI 1981). What a neighbour is moved by besides, in most tiles, is its misalignment; so is what quadrants are moved by
in different directions.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.light_field.disparities.shifts import SHIFT_TILE, group_by_neighbours, list_neighbours
from ciir.models.light_field.planes import Range

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Plane
    from ciir.models.light_field.windows import View

    Floats = NDArray[np.float32]

UNKNOWN = Range(-1.0, 1.0)
"""The range that is used if it can't be measured."""
FARTHEST = 1.5
"""Largest disparity, in either direction, of views that don't need to be shifted."""
MOST_TILES = 400
"""Most tiles of a view that are compared."""
TILES_AT_ONCE = 2000
"""Most tiles, of several views together, that are compared at once."""
SPREAD = (0.7548776662466927, 0.5698402909980532)
"""Steps of a sequence of rows and columns that fills a square evenly (Roberts 2018: 1 over the plastic number, and the
square of that)."""
LEAST_TILES = 8
"""Fewest tiles with a precise disparity from which a range is measured."""
LEAST_TEXTURED = 24
"""Fewest tiles textured along both axes, in a view or a quadrant, from which a misalignment is measured. Fewer mislead
in renderings of shiny meshes."""
FROM_QUADRANT = (4 / 3) ** 0.5
"""If a view was turned or scaled about its middle, this is the root mean square over the view of the distance by which
that moves its pixels, divided by the distance in the middle of a quadrant."""
WHOLE = (-1, 0, 1)
"""The disparities, relative to a tile's shift, that are refined."""
REFINED = 0.75
"""Largest refinement, pixels."""
PRECISION = 0.06
"""Largest standard error of a tile's disparity, pixels. Views of noise have 0.1 and more."""
TEXTURE = 0.004
"""Smallest gradient of a tile, root mean square, in luma of [0, 1] for each pixel."""
SHARE = 0.02
"""The share of the tiles that may lie beyond each end of a range, because outlines and reflections move differently."""
MARGIN, MARGIN_SHARE = 0.06, 0.05
"""The margin at each end of a range: pixels, plus a share of its width."""
INNER = 2
"""Pixels on each side of a tile that its gradient needs."""


class Tiles(NamedTuple):
    """What the tiles of a view show."""

    disparities: Floats
    """The disparities minus the view's shifts of those tiles that have a precise one."""
    misalignment: float
    """The mean distance, pixels, of the direct neighbours from where they should be, as a whole or, if that is larger,
    because quadrants are moved differently; 0 if too few tiles show it."""


class _Fit(NamedTuple):
    """Sums over tiles, which determine the disparity with the least squared difference."""

    squares: Floats
    """Sums of the squared gradient, `(n,)`."""
    along: Floats
    """Sums of the gradient times the difference between views, for each of `WHOLE`, `(3, n)`."""
    differences: Floats
    """Sums of the squared difference, `(3, n)`."""
    by_axis: Floats
    """Sums of the squared gradient down, that across, and the product of both, `(3, n)`."""
    by_neighbour: Mapping[View, Floats]
    """Sums of the gradient down, and of that across, times the difference from one neighbour, by its offset and for
    each of `WHOLE`, `(3, 2, n)`."""
    pixels: int
    """The number of pixels in each sum."""


def measure_ranges(
    lumas: Mapping[View, Plane],
    wanted: Sequence[View],
    grid: tuple[int, int],
    shifts: Sequence[NDArray[np.int64]],
) -> tuple[list[Range], list[float]]:
    """Measures, for each view of `wanted` in a grid of `grid` views, the range of its tiles' disparities minus their
    `shifts`, and its misalignment (`Tiles`). The `shifts`, `(R, C)` each, and `lumas` are as for
    `models.light_field.disparities.shifts.measure_shifts`.

    The range is `UNKNOWN` if too few tiles have texture, or views don't match. Only the direct neighbours, up to four,
    are compared. From one view to the next, content moves by the disparity towards larger coordinates. A view's range
    doesn't depend on which others are wanted.
    """
    if shifts[0].size < LEAST_TILES:
        return [UNKNOWN] * len(wanted), [0.0] * len(wanted)
    tiles = np.stack(_select_tiles(*shifts[0].shape))
    known = {view: own[*tiles] for view, own in zip(wanted, shifts, strict=True)}
    found = {}
    for group in group_by_neighbours(wanted, grid, max(1, TILES_AT_ONCE // tiles.shape[1])):
        for view, some in zip(group, estimate_tiles(lumas, group, grid, tiles, [known[v] for v in group]), strict=True):
            is_known = len(some.disparities) >= LEAST_TILES
            found[view] = (_enclose(some.disparities) if is_known else UNKNOWN), some.misalignment
    return [found[view][0] for view in wanted], [found[view][1] for view in wanted]


def _select_tiles(down: int, across: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns rows and columns of up to `MOST_TILES` of `down x across` tiles, spread evenly but not in lines."""
    if down * across <= MOST_TILES:
        rows, cols = np.indices((down, across)).reshape(2, -1)
        return rows, cols
    places = np.outer(SPREAD, np.arange(MOST_TILES)) % 1
    rows, cols = (places * [[down], [across]]).astype(np.int64)
    return rows, cols


def estimate_tiles(
    lumas: Mapping[View, Plane],
    group: Sequence[View],
    grid: tuple[int, int],
    tiles: NDArray[np.int64],
    shifts: Sequence[NDArray[np.int64]],
) -> Iterator[Tiles]:
    """Yields what `tiles` `(2, n)`, rows and columns, show for each view of a `group` of `group_by_neighbours`, whose
    `shifts` `(n,)` are given.
    """
    fit = _compare_tiles(lumas, group, grid, tiles * SHIFT_TILE, np.concatenate(shifts))
    squares = np.maximum(fit.squares, np.finfo(np.float32).tiny)
    refined = np.clip(fit.along / squares, -REFINED, REFINED)
    left = fit.differences - 2 * refined * fit.along + refined * refined * squares
    best = left.argmin(axis=0), np.arange(len(squares))
    variance = np.maximum(left[best], 0) / fit.pixels
    is_precise = variance < PRECISION**2 * squares
    is_precise &= squares > TEXTURE**2 * fit.pixels
    disparities: Floats = np.array(WHOLE, np.float32)[best[0]] + refined[best]
    is_textured = fit.by_axis[:2].min(axis=0) > TEXTURE**2 * SHIFT_TILE**2  # along both axes
    for number in range(len(group)):
        part = slice(number * tiles.shape[1], (number + 1) * tiles.shape[1])
        shown = part.start + np.flatnonzero(is_textured[part])
        misalignment = 0.0
        if len(shown) >= LEAST_TEXTURED and fit.by_neighbour:
            rests = _find_rests(fit, shown, best[0][shown], refined[best][shown])
            misalignment = _measure_misalignment(rests, tiles[:, shown - part.start])
        yield Tiles(disparities[part][is_precise[part]], misalignment)


def _find_rests(fit: _Fit, tiles: NDArray[np.intp], whole: NDArray[np.intp], refined: Floats) -> Floats:
    """Returns how far each neighbour of a view is, in each of `tiles` `(m,)`, from where the view's disparity moves it,
    down and across: `(neighbours, 2, m)`. `whole`: which of `WHOLE` their disparities have. `refined`: the rest of
    their disparities.
    """
    by_axis, rests = fit.by_axis[:, tiles], []
    for offset, sums in fit.by_neighbour.items():
        axis, known = (0 if offset[0] else 1), sum(offset) * refined
        rest = sums[whole, :, tiles].T  # (2, m)
        rest[1 - axis] -= known * by_axis[2]
        rest /= by_axis[:2]
        rest[axis] -= known
        rests.append(rest)
    return np.array(rests)


def _measure_misalignment(rests: Floats, places: NDArray[np.int64]) -> float:
    """Returns the misalignment of a view, whose tiles at `places` `(2, m)`, rows and columns, have these `rests`
    `(neighbours, 2, m)`. The distance of each neighbour is the median of tiles down, and that across.

    If cameras were turned about their axes, or differ in focal length or distortion, opposite quadrants of a view are
    moved in opposite directions, and the median of all tiles is about 0. So it is also measured how far the medians of
    each quadrant are from those of all tiles.
    """
    low = places <= np.median(places, axis=1, keepdims=True)
    quadrants = [down & across for down, across in product((low[0], ~low[0]), (low[1], ~low[1]))]
    whole = _find_medians(rests)
    parts = [_find_medians(rests[..., some]) for some in quadrants if some.sum() >= LEAST_TEXTURED]
    turned = [FROM_QUADRANT * np.hypot(*(part - whole).T).mean() for part in parts]
    return float(max([np.hypot(*whole.T).mean(), *turned]))


def _find_medians(rests: Floats) -> Floats:
    """Returns the medians of `(neighbours, 2, m)` over the last axis, the upper ones if `m` is even."""
    middle = rests.shape[2] // 2
    return np.partition(rests, middle, axis=2)[..., middle]  # several times as fast as np.median


def _compare_tiles(
    lumas: Mapping[View, Plane],
    group: Sequence[View],
    grid: tuple[int, int],
    corners: NDArray[np.int64],
    shifts: NDArray[np.int64],
) -> _Fit:
    """Compares the tiles at `corners` `(2, n)` of each view of a group with its direct neighbours, moved back by the
    `shifts` `(len(group)*n,)` and by each of `WHOLE`.
    """
    corners = np.tile(corners, len(group))
    own = _cut_tiles([lumas[view] for view in group], corners - INNER, (SHIFT_TILE + 2 * INNER,) * 2)
    slopes = _measure_slope(own[:, :, INNER:-INNER]), _measure_slope(own[:, INNER:-INNER].transpose(0, 2, 1))
    squares = [_sum_products(slope, slope) for slope in slopes]
    by_axis = np.stack([*squares, _sum_products(slopes[0], slopes[1].transpose(0, 2, 1))])
    by_neighbour = {}
    total = np.zeros(len(shifts), np.float32)
    along, differences = (np.zeros((len(WHOLE), len(shifts)), np.float32) for _ in range(2))
    neighbours = list_neighbours(group, grid)
    for offset, others in neighbours.items():
        axis, sign = (0, offset[0]) if offset[0] else (1, offset[1])
        moved = corners.copy()
        moved[axis] += sign * shifts - 1
        sides = [SHIFT_TILE, SHIFT_TILE]
        sides[axis] += 2
        other = _cut_tiles([lumas[view] for view in others], moved, (sides[0], sides[1]))
        other = other.transpose(0, axis + 1, 2 - axis)
        here = own[:, INNER:-INNER, INNER:-INNER].transpose(0, axis + 1, 2 - axis)
        total += squares[axis]
        across, sums = slopes[1 - axis].transpose(0, 2, 1), np.empty((len(WHOLE), 2, len(shifts)), np.float32)
        for number, whole in enumerate(WHOLE):
            difference = here - other[:, 1 + sign * whole :][:, :SHIFT_TILE]
            sums[number, axis] = _sum_products(slopes[axis], difference)
            sums[number, 1 - axis] = _sum_products(across, difference)
            along[number] += sign * sums[number, axis]
            differences[number] += _sum_products(difference, difference)
        by_neighbour[offset] = sums
    return _Fit(total, along, differences, by_axis, by_neighbour, max(1, len(neighbours)) * SHIFT_TILE**2)


def _measure_slope(tiles: Floats) -> Floats:
    """Returns the gradient along axis 1 of tiles `(n, side + 2*INNER, side)`, by differences of fourth order. Those of
    second order are too small for fine texture, which makes disparities too large."""
    near, far = tiles[:, 3:-1] - tiles[:, 1:-3], tiles[:, 4:] - tiles[:, :-4]
    return np.asarray(near * np.float32(2 / 3) - far * np.float32(1 / 12))


def _sum_products(one: Floats, other: Floats) -> Floats:
    """Multiplies two arrays `(n, h, w)` and sums over the tiles: `(n,)`."""
    return np.asarray(np.einsum("nij,nij->n", one, other))


def _cut_tiles(lumas: Sequence[Plane], corners: NDArray[np.int64], sides: tuple[int, int]) -> Floats:
    """Cuts tiles of `sides` at `corners` `(2, n)`: `(n, h, w)`. The first `n / len(lumas)` are cut from the first of
    `lumas` `(H, W)`, and so on. Beyond a view its edge pixels are repeated.
    """
    height, width = lumas[0].shape
    rows, cols = (
        np.clip(first[:, None] + np.arange(side), 0, length - 1)
        for first, side, length in zip(corners, sides, (height, width), strict=True)
    )
    places = np.split(rows[:, :, None] * width + cols[:, None, :], len(lumas))
    return np.concatenate([luma.ravel()[some] for luma, some in zip(lumas, places, strict=True)])


def _enclose(disparities: Floats) -> Range:
    """Returns the range of all disparities except the outermost, with a margin."""
    low, high = np.quantile(disparities, [SHARE, 1 - SHARE])
    margin = MARGIN + MARGIN_SHARE * (high - low)
    return Range(float(low - margin), float(high + margin)).round_outwards()
