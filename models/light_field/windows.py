"""Windows: the 5x5 views of a light field's grid that help to upscale one of them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

View = tuple[int, int]
"""A view's row v and column u in the grid of views."""

WINDOW_SIDE = 5
"""Views along each side of a window."""
MINIMUM_GRID = 3
"""Fewest views along each side of a grid for light-field networks. Views of a smaller grid are upscaled one by one."""


class Axis(NamedTuple):
    """The rows or the columns of a window, in order."""

    views: tuple[int, ...]
    """`WINDOW_SIDE` numbers in the grid. In a smaller grid the last ones repeat the view's own number."""
    present: NDArray[np.float32]
    """`(WINDOW_SIDE,)`: 1 for the view itself, 0.5 for another, 0 where the grid has no more."""

    def mirror(self) -> tuple[Axis, list[int]]:
        """Returns the axis of the mirrored grid, and the places of its views in this one, `WINDOW_SIDE`. Views that the
        grid doesn't have stay last.
        """
        shown = int(np.count_nonzero(self.present))
        places = [*range(shown - 1, -1, -1), *range(shown, len(self.views))]
        return Axis(tuple(self.views[place] for place in places), self.present[places]), places


def select_axis(position: int, count: int) -> Axis:
    """Selects the window around row or column `position` of `count`: two to each side, moved inwards at the border.

    Raises `ValueError` if `position` is outside the grid.
    """
    if not 0 <= position < count:
        raise ValueError(f"view {position} of {count}: give 0 to {count - 1}")
    first = max(0, min(position - WINDOW_SIDE // 2, count - WINDOW_SIDE))
    numbers = range(first, first + WINDOW_SIDE)
    views = tuple(number if number < count else position for number in numbers)
    present = [(1.0 if number == position else 0.5) * (number < count) for number in numbers]
    return Axis(views, np.array(present, np.float32))


@lru_cache(256)  # several steps ask for the windows of the same few views
def list_window(view: View, grid: tuple[int, int]) -> tuple[tuple[View, tuple[int, int]], ...]:
    """Lists the views of the window around `view` in a grid of `grid` views, row by row, each with its offset from
    `view`: rows down and columns to the right.
    """
    rows, cols = select_axis(view[0], grid[0]), select_axis(view[1], grid[1])
    return tuple(((row, col), (row - view[0], col - view[1])) for row in rows.views for col in cols.views)


def list_required_views(wanted: Sequence[View], grid: tuple[int, int]) -> list[View]:
    """Lists every view (v, u) of the windows around `wanted` in a grid of `grid` views, row by row and each once."""
    return sorted({other for view in wanted for other, _ in list_window(view, grid)})


def find_middle(view: View, grid: tuple[int, int]) -> View:
    """Finds the middle view of the window around `view`: `view` itself, except at the border of the grid. If a small
    grid has two middle ones, the nearer one is returned.
    """
    sides = (min(WINDOW_SIDE // 2, (count - 1) // 2) for count in grid)
    v, u = (max(side, min(at, count - 1 - side)) for at, count, side in zip(view, grid, sides, strict=True))
    return v, u
