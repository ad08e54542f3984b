"""Which views of a light field help to upscale one of them: a window of 5x5 in the grid, and where it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIDE = 5
"""Views along each side of a window."""
LEAST = 3
"""Least views along each side of a grid for its views to help one another; any smaller one goes view by view."""


class Axis(NamedTuple):
    """The rows, or the columns, of a window."""

    views: tuple[int, ...]
    """Their `SIDE` numbers in the grid; where the grid has fewer, the rest repeat the view's own."""
    place: NDArray[np.float32]
    """`(2, SIDE)`: how far each stands from the view's own, in views; and 1, or 0 where it only fills the window."""


def axis(position: int, count: int) -> Axis:
    """The window about number `position` of `count`: those nearest to it, pushed inwards at the border of the grid.

    Raises `ValueError` where there is no such number.
    """
    if not 0 <= position < count:
        raise ValueError(f"view {position} of {count}: give 0 to {count - 1}")
    size = min(count, SIDE)
    first = min(max(position - SIDE // 2, 0), count - size)
    views = (*range(first, first + size), *[position] * (SIDE - size))
    present = [1.0] * size + [0.0] * (SIDE - size)
    return Axis(views, np.array([[view - position for view in views], present], np.float32))
