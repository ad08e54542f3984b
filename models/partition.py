"""Which rectangles of a picture the network should see, where each cell has an error if it doesn't: the cheapest ones.

A tree of halvings of the picture is searched: each rectangle of it is interpolated, run, or made of its two halves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.cells import CELL, areas

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.cells import Depth

CALL = 150
"""What a window costs beside its pixels, in pixels. It is that little as windows of one size run together."""
WORTH = 0.75
"""Share of a picture's cost above which it goes whole: interpolation and scores cost a tenth of it (int8: a fifth)."""
SEES = 1.25
"""How much more than what they keep windows see at least, all together, where they are of use."""
STEPS = 7
"""Of the search for the price of an error; each halves the span in which it is sought."""
SPAN = 24.0
"""That span at first, doublings, half of it below a picture's pixels for its whole budget."""


class Window(NamedTuple):
    """A part of a picture that the network sees, and the part of that which is kept, input pixels."""

    top: int
    left: int
    height: int
    width: int
    rows: tuple[int, int]
    """First and last (not included) that are kept, of the picture."""
    cols: tuple[int, int]

    @property
    def kept(self) -> int:
        """Pixels."""
        return (self.rows[1] - self.rows[0]) * (self.cols[1] - self.cols[0])

    def put(self, large: NDArray[Depth], result: NDArray[Depth], scale: int) -> None:
        """Copies what is kept of the window's result into the picture's."""
        (top, bottom), (left, right) = self.rows, self.cols
        result[top * scale : bottom * scale, left * scale : right * scale] = large[
            (top - self.top) * scale : (bottom - self.top) * scale,
            (left - self.left) * scale : (right - self.left) * scale,
        ]


class _Level(NamedTuple):
    """Rectangles of one size that cover a picture, each of two of the level below."""

    axis: int
    """Along which those two lie."""
    errors: NDArray[np.float64]
    costs: NDArray[np.float64]
    """Of running them through the network, in pixels, halo included."""
    size: tuple[int, int]
    """Cells."""


def windows(cells: NDArray[np.float64], height: int, width: int, around: int, budget: float) -> list[Window] | None:
    """What the network should see of a picture; None where it may as well see all of it.

    `cells`: predicted squared error of each when it is interpolated, summed over its pixels; what is outside the
    windows adds up to `budget` at most. Each rectangle of a halving of the picture into cells is interpolated, run, or
    made of its two halves, whichever is cheapest at a price for each error; the price is the lowest that keeps the
    budget (a Lagrangian over a tree: Shoham and Gersho, IEEE Trans. ASSP 36(9), 1988).
    """
    if cells.sum() <= budget:
        return []
    if SEES * _detailed(cells, height, width, budget) > WORTH * height * width:
        return None
    levels = _levels(cells, height, width, around)
    whole = float(height * width + CALL)
    middle = np.log2(whole / budget)
    low, high = middle - SPAN / 2, middle + SPAN / 2
    for _ in range(STEPS):
        middle = (low + high) / 2
        if _solve(levels, 2.0**middle)[1] <= budget:
            high = middle
        else:
            low = middle
    cost, spent, choices = _solve(levels, 2.0**high)
    if spent > budget or cost - spent * 2.0**high > WORTH * whole:
        return None
    return _chosen(levels, choices, height, width, around)


def _detailed(cells: NDArray[np.float64], height: int, width: int, budget: float) -> int:
    """The fewest pixels in cells without which the others keep the budget."""
    pixels = areas(height, width).ravel()
    order = np.argsort(cells.ravel() / pixels)
    return int(pixels[order][np.cumsum(cells.ravel()[order]) > budget].sum())


def _levels(cells: NDArray[np.float64], height: int, width: int, around: int) -> list[_Level]:
    levels, size, axis = [], (1, 1), 0
    while True:
        costs = np.multiply.outer(_seen(height, size[0], around), _seen(width, size[1], around)) + CALL
        levels.append(_Level(axis, cells, costs, size))
        if cells.size == 1:
            return levels
        axis = int(cells.shape[1] > cells.shape[0])
        cells = _paired(cells, axis)
        size = (size[0] * (2 - axis), size[1] * (1 + axis))


def _seen(side: int, cells: int, around: int) -> NDArray[np.float64]:
    """Pixels along one side of the picture that the window of each rectangle of so many cells has."""
    return np.full(-(-side // (cells * CELL)), float(min(side, cells * CELL + 2 * around)))


def _paired(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Sums of neighbours along an axis; the last one stands alone where their number is odd."""
    return np.asarray(np.add.reduceat(values, np.arange(0, values.shape[axis], 2), axis=axis))


def _solve(levels: list[_Level], price: float) -> tuple[float, float, list[NDArray[np.int8]]]:
    """The least cost of a picture with its errors priced, the error that it has then, and for each level which
    rectangles are interpolated (0), run (1) or halved (2).
    """
    choices: list[NDArray[np.int8]] = []
    least = spent = levels[0].errors
    for axis, errors, costs, _ in levels:
        priced = errors * price
        runs = costs < priced
        own, left = np.where(runs, costs, priced), np.where(runs, 0.0, errors)
        choice = runs.astype(np.int8)
        if choices:
            halved = _paired(least, axis)
            better = halved < own
            own, left = np.where(better, halved, own), np.where(better, _paired(spent, axis), left)
            choice[better] = 2
        least, spent = own, left
        choices.append(choice)
    return float(least[0, 0]), float(spent[0, 0]), choices


def _chosen(
    levels: list[_Level], choices: list[NDArray[np.int8]], height: int, width: int, around: int
) -> list[Window]:
    """The windows of what is run, from the largest rectangles down."""
    found = []
    asked = np.ones((1, 1), np.bool_)
    for number in reversed(range(len(levels))):
        level, choice = levels[number], choices[number]
        for row, col in np.argwhere(asked & (choice == 1)).tolist():
            (top, rows, kept_rows), (left, cols, kept_cols) = (
                _window(place * cells * CELL, cells * CELL, side, around)
                for place, cells, side in ((row, level.size[0], height), (col, level.size[1], width))
            )
            found.append(Window(top, left, rows, cols, kept_rows, kept_cols))
        if number:
            halves = np.repeat(asked & (choice == 2), 2, axis=level.axis)
            rows, cols = choices[number - 1].shape
            asked = halves[:rows, :cols]
    return found


def _window(start: int, length: int, side: int, around: int) -> tuple[int, int, tuple[int, int]]:
    """Where a window begins that sees `around` around a span, how long it is, and the span within the picture. All of a
    length have one size, moved in where they would reach over the picture's border.
    """
    size = min(side, length + 2 * around)
    return min(max(0, start - around), side - size), size, (start, min(side, start + length))
