"""Measures after how many pixels a picture repeats: an elemental image array after each elemental image, a mosaic after
each view.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

LINES = 128
"""How many rows and columns are looked at, evenly spaced."""
LEAST_CORRELATION, CLEAR = 0.2, 3.0
"""A picture is a mosaic if its correlation at a view's size is at least the first number, and at least the second times
its correlation at the size of an elemental image. Of 22 mosaics and 22 elemental image arrays of the same views (4
captured, 18 rendered, 3x3 to 30x30 views, with and without noise), none was taken for the other, and one mosaic, of
views far apart, was not recognised."""
FIRST = 0.75
"""The period is the smallest of the shifts with almost the highest correlation, at least this share of it."""
LEAST_OWN_CORRELATION = 0.1
"""The least correlation that an elemental image array has at the size of its elemental images."""
MOST_SIZES = 3
CLEARER = 1.3
"""How many times better other rows and columns must fit to be ranked before equal ones. Of 588 elemental image arrays
and mosaics (rendered, captured and drawn, PNG and JPEG), 366 have square elemental images or views. Those of 294 are
ranked first, and none of these has other rows and columns that fit 1.2 times as well. Of the 222 others, 98 are ranked
first, and 60 without this rule."""
LEAST_SIDE = 64
"""The least pixels along a side of a picture that is looked at."""


class Periods:
    """Measures how well a picture `(H, W, C)` fits itself when shifted down and across."""

    def __init__(self, picture: Pixels) -> None:
        self.size = picture.shape[0], picture.shape[1]
        is_small = min(self.size) < LEAST_SIDE
        self._correlations = [] if is_small else [_correlate(picture, axis) for axis in (0, 1)]

    def find_arrangement(self, grid: tuple[int, int]) -> Literal["eia", "mosaic"] | None:
        """Returns what the picture is: elemental images of `grid` pixels, or `grid` rows and columns of views; None if
        that is not certain.
        """
        found = []
        for values, count in zip(self._correlations, grid, strict=False):
            size = len(values) // count
            if count > 1 and size > 1:
                # Views are shifted against each other by their parallax, and so are elemental images, by less.
                far, near = _find_highest(values, size, size // 4), _find_highest(values, count, _find_reach(count))
                found.append((far, near))
        if found and all(far >= max(LEAST_CORRELATION, CLEAR * near) for far, near in found):
            sizes = [length // count for length, count in zip(self.size, grid, strict=True)]
            # What repeats after one elemental image also repeats after several.
            return None if self.repeats_within(sizes) else "mosaic"
        return "eia" if all(near >= LEAST_OWN_CORRELATION for _, near in found) else None

    def is_mosaic(self, view: tuple[int, int]) -> bool:
        """Returns whether the picture certainly is a mosaic of views of `view` pixels, which divide it."""
        rows, cols = (length // side for length, side in zip(self.size, view, strict=True))
        # Views have more pixels than there are views, elemental images fewer than there are lenses.
        return math.prod(view) > rows * cols and self.find_arrangement((rows, cols)) == "mosaic"

    def repeats_within(self, size: Sequence[int]) -> bool:
        """Returns whether the picture clearly repeats after fewer pixels than `size`, at most two thirds along one
        side.

        Parallax alone changes a period by less. What repeats after several elemental images also repeats after one.
        """
        found = self.find()
        return found is not None and any(3 * own <= 2 * each for own, each in zip(found, size, strict=True))

    def find(self) -> tuple[int, int] | None:
        """Returns the rows and columns of pixels after which the picture repeats, or None if it doesn't clearly do so
        in both directions.

        If content moves from one elemental image to the next, they are a pixel or so less or more than the elemental
        images' size.
        """
        found = []
        for values in self._correlations:
            start = int(np.argmax(values <= 0))  # neighbouring pixels are alike in any picture
            searched = values[start : len(values) // 2]
            best = searched.max(initial=0)
            if best < LEAST_CORRELATION:
                return None
            first = start + int(np.argmax(searched >= FIRST * best))
            found.append(first + int(np.argmax(values[first : first + 1 + first // 8])))
        return (found[0], found[1]) if found else None

    def rank_sizes(self) -> list[tuple[int, int]]:
        """Returns sizes, as rows and columns of pixels, that divide the picture and after which it repeats, the
        likeliest first.

        There are at most `MOST_SIZES`, and none if the picture shows none. Sizes have equal rows and columns if any
        such size fits. Those near the period that `find` gives come first if they fit `CLEARER` times as well.
        """
        down, across = [_score_divisors(values) for values in self._correlations] or [{}, {}]
        if not (down and across):
            return []

        def score(size: tuple[int, int]) -> float:
            return down[size[0]] + across[size[1]]

        equal = sorted(((side, side) for side in down.keys() & across.keys()), key=lambda size: (-score(size), size))
        if not equal:
            return [(max(down, key=down.__getitem__), max(across, key=across.__getitem__))]
        if (period := self.find()) is not None:
            rows = [side for side in down if is_about(period[0], side)]
            cols = [side for side in across if is_about(period[1], side)]
            near = [(max(rows, key=down.__getitem__), max(cols, key=across.__getitem__))] if rows and cols else []
            equal = [*(size for size in near if score(size) > CLEARER * score(equal[0])), *equal]
        return equal[:MOST_SIZES]


def is_near(period: int, size: int) -> bool:
    """Returns whether parallax may turn a repetition after `size` pixels into one after `period` pixels."""
    return abs(period - size) <= 1 + period // 16


def is_about(period: int, size: int) -> bool:
    """Returns the same as `is_near`, for the largest possible parallax."""
    return abs(period - size) <= _find_reach(size)


def _find_reach(size: int) -> int:
    """Returns by how many pixels parallax may change the period of elemental images of `size` pixels."""
    return 1 + size // 8


def _score_divisors(values: NDArray[np.float64]) -> dict[int, float]:
    """Returns the highest correlation near each divisor of the length that has `LEAST_OWN_CORRELATION` there.

    A correlation counts less the farther away it is.
    """
    start = int(np.argmax(values <= 0))
    beyond = np.where(np.arange(len(values)) < start, -1.0, values)  # neighbouring pixels are alike in any picture
    found = {}
    for size in (size for size in range(2, len(values) // 2 + 1) if len(values) % size == 0):
        reach = _find_reach(size)
        near = beyond[size - reach : size + reach + 1]
        if near.max() >= LEAST_OWN_CORRELATION:
            away = np.abs(np.arange(-reach, reach + 1)) / (reach + 1)
            found[size] = float((near * (1 - away / 2)).max())
    return found


def _find_highest(values: NDArray[np.float64], shift: int, reach: int) -> float:
    return float(values[max(1, shift - reach) : shift + reach + 1].max(initial=-1))


def _correlate(picture: Pixels, axis: int) -> NDArray[np.float64]:
    """Returns the correlation of the gradient along `axis` with itself, by the shift in pixels, 1 at shift 0."""
    along = np.moveaxis(picture, axis, 1)
    chosen = np.linspace(0, len(along) - 1, min(LINES, len(along))).astype(int)
    middle = (picture.shape[2] - 1) // 2  # grey or green
    lines: NDArray[Any] = along[chosen, :, middle].astype(np.float32)
    slopes = np.diff(lines, axis=1)
    length = slopes.shape[1]
    size = 1 << (2 * length - 1).bit_length()
    powers = (np.abs(np.fft.rfft(slopes, size, axis=1)) ** 2).sum(axis=0)
    sums = np.fft.irfft(powers)[:length] / np.arange(length, 0, -1)
    return np.append(sums / max(sums[0], 1e-9), 0.0)
