"""Planes: the disparities that a light-field network tries, and the filters that combine a window of views for each.

Planes are spread evenly over the range of a scene's disparities, so that few are enough.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.light_field.view_filters import make_filters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.light_field.windows import Axis

REACH = 5
"""Taps on each side of a pixel. At large disparities the outer views of a window lie beyond them and don't count."""
PHASE = 0.25
"""Distance of a fine sample from its coarse sample, in LR pixels, at scale 2."""
NEAR = 1.6
"""Largest distance in LR pixels at which a view's samples are used for the fine picture."""
CLOSE = 0.6
"""Distance in LR pixels at which the weight of a sample in the deviation, which falls linearly, reaches zero."""
LEAST = 0.05
"""Smallest distance between planes, LR pixels from one view to the next."""
STEP = 1 / 8
"""The ends of ranges are multiples of this, in LR pixels."""


class Range(NamedTuple):
    """The range of a scene's disparities, LR pixels from one view to the next."""

    lowest: float
    highest: float

    def round_outwards(self) -> Range:
        """Rounds both ends outwards to multiples of `STEP`, so that few different filters are needed."""
        return Range(float(np.floor(self.lowest / STEP)) * STEP, float(np.ceil(self.highest / STEP)) * STEP)


def place_planes(disparities: Range, count: int) -> NDArray[np.float64]:
    """Returns `count` disparities from the lowest to the highest, at least `LEAST` apart, `(count,)`."""
    middle, half = sum(disparities) / 2, (disparities.highest - disparities.lowest) / 2
    half = max(half, LEAST * (count - 1) / 2)
    return np.linspace(middle - half, middle + half, count)


def stagger(disparities: Range, count: int) -> tuple[Range, Range]:
    """Returns two ranges that contain `disparities` and whose `count` planes lie between one another's."""
    first, second = place_planes(disparities, count)[:2]
    half = float(second - first) / 2
    lowest, highest = disparities
    return Range(lowest - half, highest), Range(lowest, highest + half)


class Window(NamedTuple):
    """The inputs of a network that describe a window of views and its planes."""

    down: NDArray[np.float32]
    """The filters of the window's rows, `(count, 3, WINDOW_SIDE, 2*REACH + 1)`. Each plane has three, all with
    the sum 1: those of the fine samples at -`PHASE` and +`PHASE` LR pixels, and the weights of samples that lie close
    together, whose deviation shows whether the plane is right."""
    across: NDArray[np.float32]
    """The same for its columns."""
    description: NDArray[np.float32]
    """`(6,)`: half the number of views above, below, left and right of the view, because few views agree by chance;
    then the lowest and the highest plane."""

    def trim(self) -> Window:
        """Removes the outer taps that are zero throughout: the result is the same, in less time."""
        used = max(int(np.abs(np.flatnonzero(of.any((0, 1, 2))) - REACH).max()) for of in (self.down, self.across))
        down, across = (np.ascontiguousarray(of[..., REACH - used : REACH + used + 1]) for of in self[:2])
        return Window(down, across, self.description)


def describe_window(rows: Axis, cols: Axis, disparities: Range, count: int) -> Window:
    """Describes the window of `rows` and `cols` with `count` planes over a range of disparities."""
    down, across = (_make_filters(axis.present.tobytes(), disparities, count) for axis in (rows, cols))
    sides = []
    for axis in (rows, cols):
        before = int(axis.present.argmax())
        sides += [before, int(np.count_nonzero(axis.present)) - 1 - before]
    planes = place_planes(disparities, count)
    return Window(down, across, np.array([*(number / 2 for number in sides), planes[0], planes[-1]], np.float32))


@lru_cache(maxsize=8192)  # of 5 KB each
def _make_filters(present: bytes, disparities: Range, count: int) -> NDArray[np.float32]:
    """Makes the filters of the rows or the columns of a window."""
    there = np.frombuffer(present, np.float32)
    shown = int(np.count_nonzero(there))
    offsets = np.arange(shown) - int(there.argmax())
    taps = np.arange(-REACH, REACH + 1)
    planes = place_planes(disparities, count)
    made = np.zeros((count, 3, len(there), len(taps)))
    made[:, :2, :shown] = make_filters(planes, np.gradient(planes), offsets, taps, reach=NEAR, phase=PHASE)
    place = taps - planes[:, None, None] * offsets[:, None]  # (count, shown, taps)
    weights = np.clip(1 - np.abs(place) / CLOSE, 0, None)
    made[:, 2, :shown] = weights / weights.sum((1, 2), keepdims=True)
    filters = made.astype(np.float32)
    filters.flags.writeable = False
    return filters
