"""Pictures of a mesh's view through a lens array that is moved by fractions of its pitch.

A light-field network needs pictures that sample the same content at other points. Other views of the array do, but they
also see around the object. The moving array-lens technique (Jang and Javidi, Optics Letters 27, 324, 2002) has no such
parallax: the same view is taken again while the lenses stand at other positions. Of a mesh all these pictures are one
rendering of the view, with 5x5 samples for each lens.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.planes import Range
from ciir.models.light_field.windows import WINDOW_SIDE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.views import View

MOVED = 2
"""Samples, of `WINDOW_SIDE` for each pitch, from one position of the lenses to the next.

Five such positions fall on all fifths of a pitch, as they do for 1 and 3. With 3 a network is as accurate, with 1 it is
0.7 dB worse: neighbouring views of its training were rarely that close.
"""
DISPARITIES = Range(-MOVED / WINDOW_SIDE, -MOVED / WINDOW_SIDE)
"""The disparity of all content, in pixels from one position to the next: where lenses move right, it moves left."""
MOST_SIDE = 8192
"""Most samples along a side of the rendering, which OpenGL can draw everywhere."""


def refine_array(array: LensArray) -> LensArray:
    """Returns the array of all samples: `WINDOW_SIDE x WINDOW_SIDE` for each lens, and for one more lens at each side.

    Raises `InvalidOption` if it has too many lenses.
    """
    return replace(array, rows=array.rows + 2, cols=array.cols + 2).refine(WINDOW_SIDE)


def count_samples(array: LensArray) -> int:
    """Counts the samples of one view."""
    return (array.rows + 2) * (array.cols + 2) * WINDOW_SIDE**2


def count_samples_each(array: LensArray) -> int:
    """Counts the samples of one view for each of its pictures, rounded up."""
    return -(-count_samples(array) // WINDOW_SIDE**2)


def is_possible(array: LensArray, most: int) -> bool:
    """Returns whether a view has at most `most` samples, and at most `MOST_SIDE` along a side."""
    return count_samples(array) <= most and (max(array.rows, array.cols) + 2) * WINDOW_SIDE <= MOST_SIDE


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
    sampled: Iterator[NDArray[np.uint8]], places: Sequence[View], *, averages: bool
) -> Iterator[NDArray[np.uint8]]:
    """Yields the pictures at `places`, given the samples of their views once each and in order; see `split_samples`."""
    kept: dict[View, NDArray[np.uint8]] = {}
    for place in places:
        if place not in kept:
            kept.update(split_samples(next(sampled), find_view(place), averages=averages))
        yield kept.pop(place)


def split_samples(
    samples: NDArray[np.uint8], view: View, *, averages: bool
) -> Iterator[tuple[View, NDArray[np.uint8]]]:
    """Yields the pictures of `view`, `(rows, cols, c)`, and their places, given the samples of `refine_array`.

    A picture holds the sample at the middle of each lens, or the mean over its cell if `averages` is true.
    """
    rows, cols = (size // WINDOW_SIDE - 2 for size in samples.shape[:2])
    half = WINDOW_SIDE // 2
    values = average_around(samples) if averages else samples[half:-half, half:-half]
    for v, u in np.ndindex(WINDOW_SIDE, WINDOW_SIDE):
        top, left = (WINDOW_SIDE + MOVED * (position - half) for position in (v, u))
        picture = values[top::WINDOW_SIDE, left::WINDOW_SIDE][:rows, :cols]
        yield (WINDOW_SIDE * view[0] + v, WINDOW_SIDE * view[1] + u), picture


def average_around(samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the rounded means of `WINDOW_SIDE x WINDOW_SIDE` neighbouring samples, `(h - 4, w - 4, c)`."""
    height, width = (size - WINDOW_SIDE + 1 for size in samples.shape[:2])
    across = sum((samples[:, x : x + width] for x in range(WINDOW_SIDE)), np.uint16(0))
    total = sum((across[y : y + height] for y in range(WINDOW_SIDE)), np.uint16(WINDOW_SIDE**2 // 2))
    means: NDArray[np.uint8] = (total // np.uint16(WINDOW_SIDE**2)).astype(np.uint8)
    return means
