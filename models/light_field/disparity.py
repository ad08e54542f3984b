"""A light field's whole-pixel disparity: what is left after it is small enough for a network to look for."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ciir.models.light_field import network
from ciir.models.light_field.windows import WINDOW_SIDE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ciir.models.tiles import Span

    Plane = NDArray[np.float32]
    Pixels = NDArray[np.uint8] | NDArray[np.uint16]
    View = tuple[int, int]

Value = TypeVar("Value", np.float32, np.bool_)

MOST = 8
"""Largest whole disparity that is looked for, pixels from one view to the next."""
WITHIN = 1
"""Up to this nothing is moved: the networks look for 2 pixels to each side."""
BETTER = 0.8
"""A shift must leave at most this much of the difference that there is without one."""
MIDDLE = 96
"""Pixels along each side of the middle of a view, which is all that is compared."""


def of(views: Mapping[View, Pixels], view: View, grid: tuple[int, int]) -> int:
    """`whole_disparity` of the middle of a view of a grid of `grid` views, by those right beside it."""
    beside = {(down, right): (view[0] + down, view[1] + right) for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0))}
    there = {by: at for by, at in beside.items() if 0 <= at[0] < grid[0] and 0 <= at[1] < grid[1]}
    there = dict(list(there.items())[:2])  # more tell no more, and a view waits for this
    rows, cols = (slice(max(0, (side - MIDDLE) // 2), (side + MIDDLE) // 2) for side in views[view].shape[:2])
    return whole_disparity(
        luma(views[view], (rows, cols)), {by: luma(views[at], (rows, cols)) for by, at in there.items()}
    )


def whole_disparity(view: Plane, neighbours: Mapping[tuple[int, int], Plane]) -> int:
    """By how many whole pixels content moves from `view` to a neighbour for each view between them; 0 where that is
    little or can't be told. It is what a shear of the light field (Ng, SIGGRAPH 2005, equation 4.2) can take away.

    `view`, `neighbours`: luma `(H, W)`; the neighbours by their offsets (down, right), such as (0, 1).
    """
    most = min(MOST, (min(view.shape) - 1) // 4)
    shifts = range(-most, most + 1)
    cost = np.zeros(len(shifts))
    for (down, right), other in neighbours.items():
        cost += [_difference(view, other, shift * down, shift * right) for shift in shifts]
    best = int(np.argmin(cost))
    near = float(cost[most - WITHIN : most + WITHIN + 1].min()) if most >= WITHIN else 0.0
    return shifts[best] if abs(shifts[best]) > WITHIN and cost[best] < BETTER * near else 0


def _difference(one: Plane, other: Plane, down: int, right: int) -> float:
    """Mean absolute difference of `one` at (y, x) and `other` at (y + down, x + right), where both are."""
    height, width = one.shape
    here = one[max(0, -down) : height - max(0, down), max(0, -right) : width - max(0, right)]
    there = other[max(0, down) : height - max(0, -down), max(0, right) : width - max(0, -right)]
    return float(np.abs(here - there).mean())


def luma(picture: Pixels, part: Span | None = None, by: int = 0) -> Plane:
    """Luma in [0, 1] of a picture `(H, W, C)`, or of a part of it as `margined` takes it."""
    picture = picture if part is None else margined(picture, part, by)
    return np.minimum(network.luma(picture, np.iinfo(picture.dtype).max), 1)


def margined(picture: Pixels, part: Span, by: int) -> Pixels:
    """A part of a picture `(H, W, C)`, with as much around it as views may be moved by; beyond the picture its edge
    pixels are repeated.
    """
    if not by:
        return picture[part]
    margin = abs(by) * (WINDOW_SIDE // 2)
    rows, cols = (
        np.clip(np.arange(side.start - margin, side.stop + margin), 0, length - 1)
        for side, length in zip(part, picture.shape[:2], strict=True)
    )
    made: Pixels = picture[rows[:, None], cols]
    return made


def moved(plane: NDArray[Value], by: int, offset: tuple[int, int]) -> NDArray[Value]:
    """Of a part with its margin, `(H, W)`, what lies `by` pixels further for each view down and right."""
    margin = abs(by) * (WINDOW_SIDE // 2)
    rows, cols = (
        slice(margin + by * step, length - margin + by * step) for step, length in zip(offset, plane.shape, strict=True)
    )
    return plane[rows, cols]


def as_float(picture: Pixels) -> NDArray[np.float32]:
    """In [0, 1]."""
    return picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)
