"""Pictures of a mesh's view through a lens array that is moved by fractions of its pitch.

A light-field network needs pictures that sample the same content at other points. Other views of the array do, but they
also see around the object. The moving array-lens technique (Jang and Javidi, Optics Letters 27, 324, 2002) has no such
parallax: the same view is taken again while the lenses stand at other positions. For a mesh, all these pictures are one
rendering of the view, with 5x5 samples for each pinhole and 10x10 for each lenslet.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.network import compute_luma
from ciir.models.light_field.planes import Range
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.renderer.sampling import average_cells

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.views import View

PICTURES = WINDOW_SIDE**2
"""Number of a view's pictures."""
MOVED = 2
"""Cells, of `WINDOW_SIDE` for each pitch, from one position of the lenses to the next.

Five such positions fall on all fifths of a pitch, as they do for 1 and 3. With 3 a network is as accurate, with 1 it is
0.7 dB worse: neighbouring views of its training were rarely that close.
"""
DISPARITIES = Range(-MOVED / WINDOW_SIDE, -MOVED / WINDOW_SIDE)
"""The disparity of all content, in pixels from one position to the next: when lenses move right, it moves left."""
CELL_SAMPLES = 2
"""A lenslet's samples along each side of a cell. Eight views are 1.3 dB worse with 1, and 0.5 dB better with 3."""
MOST_SAMPLES, MOST_SIDE = 16_000_000, 8192
"""Most samples of one view, which take half a gigabyte, and along a side, which OpenGL can draw everywhere."""


def refine_array(array: LensArray) -> LensArray:
    """Returns the array of all cells: `WINDOW_SIDE x WINDOW_SIDE` for each lens, and for one more lens at each side.

    Raises `InvalidOption` if it has too many lenses.
    """
    return replace(array, rows=array.rows + 2, cols=array.cols + 2).refine(WINDOW_SIDE)


def find_cell_side(lens_side: int) -> int:
    """Returns the number of samples along each side of a cell, given that along each side of a lens of the array."""
    return 1 if lens_side == 1 else CELL_SAMPLES


def count_cells(array: LensArray) -> int:
    """Counts the cells of one view."""
    return (array.rows + 2) * (array.cols + 2) * WINDOW_SIDE**2


def count_samples(array: LensArray, lens_side: int) -> int:
    """Counts the samples of one view; `lens_side` is the same as in `find_cell_side`."""
    return count_cells(array) * find_cell_side(lens_side) ** 2


def is_possible(array: LensArray, lens_side: int) -> bool:
    """Returns whether a view has at most `MOST_SAMPLES` samples, and at most `MOST_SIDE` along a side."""
    side = (max(array.rows, array.cols) + 2) * WINDOW_SIDE * find_cell_side(lens_side)
    return count_samples(array, lens_side) <= MOST_SAMPLES and side <= MOST_SIDE


def list_grid(grid: View) -> View:
    """Returns the rows and columns of the grid in which each of `grid` views has its pictures, as a window."""
    return WINDOW_SIDE * grid[0], WINDOW_SIDE * grid[1]


def find_place(view: View) -> View:
    """Returns the place of a view in that grid: the picture with the lenses at their own positions."""
    v, u = (WINDOW_SIDE * number + WINDOW_SIDE // 2 for number in view)
    return v, u


def find_view(place: View) -> View:
    """Returns the view whose picture is at `place` in that grid."""
    return place[0] // WINDOW_SIDE, place[1] // WINDOW_SIDE


def take_pictures(
    rendered: Iterator[NDArray[np.uint8]], places: Sequence[View], *, averages: bool
) -> Iterator[NDArray[np.uint8]]:
    """Yields the pictures at `places`, given the renderings of their views once each and in order; see `split_cells`.

    For pinholes, the picture in the middle is that of `average_colours`.
    """
    kept: dict[View, NDArray[np.uint8]] = {}
    for place in places:
        if place not in kept:
            cells, view = next(rendered), find_view(place)
            kept.update(split_cells(cells, view, averages=averages))
            if not averages:
                kept[find_place(view)] = average_colours(cells)
        yield kept.pop(place)


def split_cells(cells: NDArray[np.uint8], view: View, *, averages: bool) -> Iterator[tuple[View, NDArray[np.uint8]]]:
    """Yields the pictures of `view`, `(rows, cols, c)`, and their places, given its rendering by `refine_array`.

    A picture holds the cell in the middle of each lens, or the mean over the lens if `averages` is true.
    """
    values = average_around(cells) if averages else _crop_to_middles(cells)
    for position in np.ndindex(WINDOW_SIDE, WINDOW_SIDE):
        place = WINDOW_SIDE * view[0] + position[0], WINDOW_SIDE * view[1] + position[1]
        yield place, _take_picture(values, position)


def average_colours(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the picture in the middle, `(rows, cols, 3)`, with the colours of each lens's mean and its own luma.

    A light-field network takes only luma from the other pictures, so that the colours of samples would stay aliased.
    """
    sample = _take_picture(_crop_to_middles(cells), (WINDOW_SIDE // 2, WINDOW_SIDE // 2))
    mean = average_cells(cells[WINDOW_SIDE:-WINDOW_SIDE, WINDOW_SIDE:-WINDOW_SIDE], WINDOW_SIDE)
    difference = compute_luma(sample, 1) - compute_luma(mean, 1)  # levels
    coloured: NDArray[np.uint8] = np.clip(np.rint(mean + difference[..., np.newaxis]), 0, 255).astype(np.uint8)
    return coloured


def _crop_to_middles(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the cells in the middle of those that `average_around` averages."""
    half = WINDOW_SIDE // 2
    return cells[half:-half, half:-half]


def _take_picture(values: NDArray[np.uint8], position: View) -> NDArray[np.uint8]:
    """Returns the values at the lenses for one of their positions, down and across."""
    rows, cols = ((size - 1) // WINDOW_SIDE - 1 for size in values.shape[:2])
    top, left = (WINDOW_SIDE + MOVED * (number - WINDOW_SIDE // 2) for number in position)
    return values[top::WINDOW_SIDE, left::WINDOW_SIDE][:rows, :cols]


def average_around(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the rounded means of `WINDOW_SIDE x WINDOW_SIDE` neighbouring cells, `(h - 4, w - 4, c)`."""
    height, width = (size - WINDOW_SIDE + 1 for size in cells.shape[:2])
    across = np.zeros((cells.shape[0], width, cells.shape[2]), np.uint16)
    total = np.full((height, *across.shape[1:]), WINDOW_SIDE**2 // 2, np.uint16)
    for start in range(WINDOW_SIDE):
        across += cells[:, start : start + width]
    for start in range(WINDOW_SIDE):
        total += across[start : start + height]
    total //= np.uint16(WINDOW_SIDE**2)
    return total.astype(np.uint8)
