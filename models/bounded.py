"""What of a picture may be interpolated: where the network would hardly change what bicubic interpolation makes.

How far the two differ is predicted from the picture alone, by a table that was learnt from photographs and rendered
scenes: from a cell's edge score to its squared error, as ARM does it (Chen et al., ECCV 2022), with no second network.
Networks add to interpolation what a cubic can't follow, so the score is the mean square of fourth differences. A view's
predicted errors are added up, and rectangles of it are interpolated, the best bargains first, until the sum would pass
the bound. See docs/skipping.md.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from models.baselines import SCALES, Bicubic

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.skip import Tally
    from models.upscaler import Upscaler

    Floats = NDArray[np.float32]

Depth = TypeVar("Depth", np.uint8, np.uint16)

TABLES = Path(__file__).parent / "edge_scores.json"
"""Written by `python -m training.edge_scores`: a table for each network, by the SHA-256 of its file."""
AIM = 0.9
"""Share of the bound that predicted errors add up to: no table knows every picture."""
CELL = 8
"""Side of a cell, input pixels."""
REACH = 2
"""Pixels to each side that a fourth difference looks at."""
BAND = 1 << 17
"""Most pixels that are scored at once: as float they stay in the cache."""
LEAST = 64 * 64
"""Pixels below which a picture goes whole: looking at it takes a fifth as long as the network, and seldom pays."""
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


class Table(NamedTuple):
    """The error that an edge score stands for."""

    scores: NDArray[np.float64]
    """`(n,)`, ascending, squared levels (of 255)."""
    errors: NDArray[np.float64]
    """`(n,)`, ascending: mean square of the levels by which network and interpolation differ. Beyond the last score
    nothing was learnt: no bound holds there."""
    around: int
    """Pixels that a window sees around what is kept of it: fewer than the network's radius, as what is farther away
    changes less than the bounds that are of use."""

    def predicted(self, scores: Floats) -> NDArray[np.float64]:
        """Mean square error of cells of these scores, of any shape; inf beyond what was learnt."""
        logs = np.interp(np.log(np.maximum(scores, self.scores[0])), np.log(self.scores), np.log(self.errors))
        return np.where(scores <= self.scores[-1], np.exp(logs), np.inf)


@lru_cache(maxsize=1)
def tables() -> dict[str, Table]:
    """All shipped tables, by the SHA-256 of the network."""
    said = json.loads(TABLES.read_text(encoding="utf-8"))["tables"]
    return {
        one["sha256"]: Table(np.array(one["scores"], float), np.array(one["errors"], float), one["around"])
        for one in said
    }


def table_of(upscaler: Upscaler) -> Table | None:
    """An upscaler's table; None where none was learnt for it, and nothing of its pictures is interpolated."""
    card = getattr(upscaler, "card", None)
    return tables().get(card.sha256) if card is not None else None


def upscale(
    run: Callable[[Upscaler, NDArray[Depth]], NDArray[Depth]],
    upscaler: Upscaler,
    pictures: NDArray[Depth],
    max_error: float,
    tally: Tally,
    *,
    of: int = 0,
) -> NDArray[Depth]:
    """`(N, H, W, C)` -> `(N, scale*H, scale*W, C)`: `run(upscaler, pictures)` to within a predicted error.

    `max_error`: root mean square of levels (of 255), over all channels of each picture, by which the result may differ;
    `of`: the pixels that it is the mean over where `pictures` are parts of larger ones. What is interpolated is added
    to `tally`. Whole go pictures with alpha, those of a network without a table, and those that are so small or so
    detailed that windows and what they see around would take as long.
    """
    count, height, width, channels = pictures.shape
    table = table_of(upscaler)
    if table is None or channels in (2, 4) or upscaler.scale not in SCALES or height * width < LEAST:
        return run(upscaler, pictures)
    budget = (AIM * max_error) ** 2 * max(of, height * width)
    plans = []
    for picture in pictures:
        cells = table.predicted(edge_scores(picture)) * _areas(height, width)
        plans.append(windows(cells, height, width, table.around, budget))
    whole = [number for number, plan in enumerate(plans) if plan is None]
    if len(whole) == count:
        return run(upscaler, pictures)
    result = run(Bicubic(upscaler.scale), pictures)
    if whole:
        result[whole] = run(upscaler, pictures[whole])
    wanted: dict[tuple[int, int], list[tuple[int, Window]]] = {}
    for number, plan in enumerate(plans):
        if plan is not None:
            tally.interpolated += height * width - sum(window.kept for window in plan)
            for window in plan:
                wanted.setdefault((window.height, window.width), []).append((number, window))
    for (rows, cols), some in wanted.items():
        parts = np.stack([pictures[n, w.top : w.top + rows, w.left : w.left + cols] for n, w in some])
        for (number, window), large in zip(some, run(upscaler, parts), strict=True):
            window.put(large, result[number], upscaler.scale)
    return result


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
    return np.asarray(sums / (_areas(height, width).astype(np.float32) * channels))


def _second(values: Floats, step: int, axis: int = 0) -> Floats:
    """Second differences along an axis, `2 * step` fewer."""
    if axis:
        return values[:, : -2 * step] + values[:, 2 * step :] - 2 * values[:, step:-step]
    return values[: -2 * step] + values[2 * step :] - 2 * values[step:-step]


def _areas(height: int, width: int) -> NDArray[np.int64]:
    """Pixels of each cell."""
    rows, cols = (np.minimum(CELL, side - np.arange(0, side, CELL)) for side in (height, width))
    return np.multiply.outer(rows, cols)


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
    areas = _areas(height, width).ravel()
    order = np.argsort(cells.ravel() / areas)
    return int(areas[order][np.cumsum(cells.ravel()[order]) > budget].sum())


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
