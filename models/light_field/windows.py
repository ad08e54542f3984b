"""Windows: the views of a light field that help to upscale one of them, 5x5 of the grid around it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

View = tuple[int, int]
"""Row v and column u in the grid of views."""

WINDOW_SIDE = 5
"""Views along each side of a window."""
MINIMUM_GRID = 3
"""Fewest views along each side of a grid for light-field networks; views of a smaller grid are upscaled one by one."""


class Axis(NamedTuple):
    """The rows, or the columns, of a window."""

    views: tuple[int, ...]
    """`WINDOW_SIDE` numbers in the grid; beyond its border the centre's own number."""
    present: NDArray[np.float32]
    """`(WINDOW_SIDE,)`: 1, or 0 beyond the border."""


def select_axis(position: int, count: int) -> Axis:
    """The window around row or column `position` of `count`: two to each side, as far as the grid reaches.

    It isn't moved inwards at the border: views further away see the scene too differently to help.

    Raises `ValueError` where `position` is outside the grid.
    """
    if not 0 <= position < count:
        raise ValueError(f"view {position} of {count}: give 0 to {count - 1}")
    offsets = range(-(WINDOW_SIDE // 2), WINDOW_SIDE // 2 + 1)
    present = [0 <= position + offset < count for offset in offsets]
    views = tuple(position + offset * is_present for offset, is_present in zip(offsets, present, strict=True))
    return Axis(views, np.array(present, np.float32))


def list_window(view: View, grid: tuple[int, int]) -> list[tuple[View, tuple[int, int]]]:
    """The views of the window around one in a grid of `grid` views, row by row, and the offset of each: rows down and
    columns to the right.
    """
    rows, cols = select_axis(view[0], grid[0]), select_axis(view[1], grid[1])
    return [((row, col), (row - view[0], col - view[1])) for row in rows.views for col in cols.views]
