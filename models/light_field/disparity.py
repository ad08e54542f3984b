"""The whole-pixel disparity of a light field, which views are shifted by before a network searches for the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ciir.models.light_field.network import compute_luma
from ciir.models.light_field.windows import WINDOW_SIDE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ciir.models.light_field.windows import View
    from ciir.models.tiles import Span

    Plane = NDArray[np.float32]
    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

Value = TypeVar("Value", np.float32, np.bool_)

MAXIMUM_DISPARITY = 8
"""Largest whole disparity that is searched for, pixels from one view to the next."""
UNSHIFTED_DISPARITY = 1
"""Up to this views are not shifted: networks search 2 pixels to each side themselves."""
MAXIMUM_RATIO = 0.8
"""A shift is used where it reduces the difference between views to at most this share."""
CENTRE_SIDE = 96
"""Pixels along each side of the centre of a view, which is all that is compared."""


def measure_disparity(views: Mapping[View, Pixels], view: View, grid: tuple[int, int]) -> int:
    """The whole disparity at the centre of a view in a grid of `grid` views, from two neighbours."""
    neighbours = [(offset, (view[0] + offset[0], view[1] + offset[1])) for offset in ((0, 1), (1, 0), (0, -1), (-1, 0))]
    present = [(offset, (v, u)) for offset, (v, u) in neighbours if 0 <= v < grid[0] and 0 <= u < grid[1]]
    rows, cols = (slice(max(0, (side - CENTRE_SIDE) // 2), (side + CENTRE_SIDE) // 2) for side in views[view].shape[:2])
    return estimate_disparity(
        crop_luma(views[view], (rows, cols)),
        {offset: crop_luma(views[other], (rows, cols)) for offset, other in present[:2]},  # more would only take time
    )


def estimate_disparity(view: Plane, neighbours: Mapping[tuple[int, int], Plane]) -> int:
    """The number of whole pixels by which content moves from one view to the next; 0 where it is small or unclear.

    A shear of the light field removes it (Ng, SIGGRAPH 2005, equation 4.2). `view`, `neighbours`: luma `(H, W)`; the
    neighbours by their offsets (down, right), such as (0, 1).
    """
    largest = min(MAXIMUM_DISPARITY, (min(view.shape) - 1) // 4)
    shifts = range(-largest, largest + 1)
    cost = np.zeros(len(shifts))
    for (down, right), other in neighbours.items():
        cost += [_compute_difference(view, other, shift * down, shift * right) for shift in shifts]
    best = int(np.argmin(cost))
    unshifted = slice(largest - UNSHIFTED_DISPARITY, largest + UNSHIFTED_DISPARITY + 1)
    near = float(cost[unshifted].min()) if largest >= UNSHIFTED_DISPARITY else 0.0
    return shifts[best] if abs(shifts[best]) > UNSHIFTED_DISPARITY and cost[best] < MAXIMUM_RATIO * near else 0


def _compute_difference(one: Plane, other: Plane, down: int, right: int) -> float:
    """Mean absolute difference of `one` at (y, x) and `other` at (y + down, x + right), where both exist."""
    height, width = one.shape
    here = one[max(0, -down) : height - max(0, down), max(0, -right) : width - max(0, right)]
    there = other[max(0, down) : height - max(0, -down), max(0, right) : width - max(0, -right)]
    return float(np.abs(here - there).mean())


def crop_luma(picture: Pixels, part: Span | None = None, shift: int = 0) -> Plane:
    """Luma in [0, 1] of a picture `(H, W, C)`, or of a part of it as `crop_with_margin` takes it."""
    picture = picture if part is None else crop_with_margin(picture, part, shift)
    return np.minimum(compute_luma(picture, np.iinfo(picture.dtype).max), 1)


def crop_with_margin(picture: Pixels, part: Span, shift: int) -> Pixels:
    """A part of a picture `(H, W, C)` with the margin that a shift of `shift` pixels per view can move it by; beyond
    the picture its edge pixels are repeated.
    """
    if not shift:
        return picture[part]
    margin = abs(shift) * (WINDOW_SIDE // 2)
    rows, cols = (
        np.clip(np.arange(side.start - margin, side.stop + margin), 0, length - 1)
        for side, length in zip(part, picture.shape[:2], strict=True)
    )
    cropped: Pixels = picture[rows[:, None], cols]
    return cropped


def shift_part(plane: NDArray[Value], shift: int, offset: tuple[int, int]) -> NDArray[Value]:
    """A part `(H, W)` without its margin, shifted by `shift` pixels for each view of its `offset` (down, right)."""
    margin = abs(shift) * (WINDOW_SIDE // 2)
    rows, cols = (
        slice(margin + shift * step, length - margin + shift * step)
        for step, length in zip(offset, plane.shape, strict=True)
    )
    return plane[rows, cols]


def convert_to_float(picture: Pixels) -> NDArray[np.float32]:
    """The picture's values in [0, 1]."""
    return picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)
