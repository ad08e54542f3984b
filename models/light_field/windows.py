"""Which views of a light field help to upscale one of them: a window of 5x5 in the grid, as far as it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    View = tuple[int, int]

WINDOW_SIDE = 5
"""Views along each side of a window."""
MINIMUM_GRID = 3
"""Least views along each side of a grid for its views to help one another; any smaller one goes view by view."""


class Axis(NamedTuple):
    """The rows, or the columns, of a window."""

    views: tuple[int, ...]
    """Their `WINDOW_SIDE` numbers in the grid; beyond its border the view's own again."""
    present: NDArray[np.float32]
    """`(WINDOW_SIDE,)`: 1, or 0 for those beyond the border."""


def select_axis(position: int, count: int) -> Axis:
    """The window about number `position` of `count`: two to each side, as far as there are any.

    It isn't pushed inwards at the border: views further away see the scene too differently to be of use.

    Raises `ValueError` where there is no such number.
    """
    if not 0 <= position < count:
        raise ValueError(f"view {position} of {count}: give 0 to {count - 1}")
    offsets = range(-(WINDOW_SIDE // 2), WINDOW_SIDE // 2 + 1)
    there = [0 <= position + offset < count for offset in offsets]
    views = tuple(position + offset * is_there for offset, is_there in zip(offsets, there, strict=True))
    return Axis(views, np.array(there, np.float32))


def list_window(at: View, grid: tuple[int, int]) -> list[tuple[View, tuple[int, int]]]:
    """The views (v, u) of the window about one of a grid of `grid`, row by row, and how far down and to the right of it
    each is.
    """
    rows, cols = select_axis(at[0], grid[0]), select_axis(at[1], grid[1])
    return [((row, col), (row - at[0], col - at[1])) for row in rows.views for col in cols.views]
