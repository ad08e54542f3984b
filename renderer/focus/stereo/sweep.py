"""A plane sweep: measures how badly each of a set of disparities fits each pixel of a view.

The view is compared with others in its row and its column of the grid, up to half the grid away: each of them moves
along one axis only, by a multiple of a fraction of a pixel, so that few interpolated pictures serve all planes.
Something in front may hide a pixel from the views on one side. So those on the left, on the right, above and below are
compared separately, and the side that agrees best counts, together with all of them at once, which keep outlines sharp.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil, gcd
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from ciir.renderer.focus.kernels import make_taps
from ciir.renderer.levels import drop_alpha

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.views import View

MOST_DIFFERENCE = 8.0
"""Largest difference that counts, in 8-bit levels: larger ones are as wrong as this one."""
MOST_SHIFT = 0.35
"""Shift in pixels: differences that this much shift makes count too, so that fine texture fits one plane better than
others."""
_AXES = (1, 2)
"""The axes down and across in a picture `(C, H, W)`."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A view to compare with, and its position."""

    axis: int
    """The one of `_AXES` along which it lies from the swept view."""
    distance: int
    """Distance in views, with its sign."""
    phases: Mapping[int, NDArray[np.float32]]
    """The picture by phase, `(C, H, W)` each: sampled that many nths of a pixel further on."""


class Sweep:
    """The views around one view that it is compared with."""

    def __init__(
        self,
        views: NDArray[Any],
        view: View,
        *,
        parts: int,
        farthest: int,
        compared: int = 2,
        blur: float = 0.0,
        own: NDArray[np.float32] | None = None,
    ) -> None:
        """`views`: `(V, U, H, W, C)`, alpha is ignored. `parts`: n; planes are whole multiples of 1/n pixels per view.
        `farthest`: views further away are not compared. `compared`: the most views on each side, evenly spread. `blur`:
        standard deviation in pixels, against noise. `own`: the view itself with less noise, as `self.own`.
        """
        self._parts = parts
        self.own = _blur(read_levels(views[view]), blur) if own is None else own
        """`(C, H, W)`: the view itself, in 8-bit levels."""
        gradient = np.sqrt(np.mean(np.square(np.gradient(self.own, axis=_AXES)), axis=1)).max(axis=0)
        self._most = MOST_DIFFERENCE + MOST_SHIFT * gradient  # (H, W)
        self.most_cost = 2 * self._most
        """`(H, W)`: the cost of a plane that fits badly."""
        self._sides: list[list[Picture]] = []
        for axis, count, at in zip(_AXES, views.shape[:2], view, strict=True):
            for sign, reach in ((-1, at), (1, count - 1 - at)):
                most = min(reach, farthest)
                side = []
                for distance in sorted({ceil(most * part / compared) for part in range(1, compared + 1)} - {0}):
                    place = list(view)
                    place[axis - 1] += sign * distance
                    picture = _blur(read_levels(views[tuple(place)]), blur)
                    phases = range(0, parts, gcd(parts, distance))
                    moved = {phase: _interpolate(picture, axis, phase / parts) for phase in phases}
                    side.append(Picture(axis, sign * distance, moved))
                if side:
                    self._sides.append(side)

    def compare(self, planes: Sequence[int]) -> NDArray[np.float32]:
        """Returns the cost of each of `planes`, in parts of a pixel per view: `(planes, H, W)` in 8-bit levels.

        A plane in which no other view reaches a pixel costs half as much as one that fits badly.
        """
        cost = np.empty((len(planes), *self.own.shape[1:]), np.float32)
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(self._compare, planes, cost))
        return cost

    def _compare(self, plane: int, cost: NDArray[np.float32]) -> None:
        """Fills `cost` `(H, W)`."""
        least, every = np.full_like(cost, np.inf), np.zeros_like(cost)
        reached = np.zeros_like(cost)
        for side in self._sides:
            total, count = np.zeros_like(cost), np.zeros_like(cost)
            for picture in side:
                whole, phase = divmod(-picture.distance * plane, self._parts)
                here, there = find_overlap(cost.shape[picture.axis - 1], whole)
                before = (slice(None),) * (picture.axis - 1)
                difference = self.own[:, *before, here] - picture.phases[phase][:, *before, there]
                total[*before, here] += np.einsum("chw,chw->hw", difference, difference)
                count[*before, here] += len(difference)
            every += total
            reached += count
            with np.errstate(divide="ignore", invalid="ignore"):
                np.fmin(least, total / count, out=least)  # NaN where no view of this side reaches
        np.maximum(reached, 1, out=reached)
        np.divide(every, reached, out=every)
        np.minimum(np.sqrt(least), self._most, out=cost)
        cost += np.minimum(np.sqrt(every), self._most)


def read_levels(view: NDArray[Any]) -> NDArray[np.float32]:
    """Returns `(C, H, W)` in 8-bit levels, without alpha, of a view `(H, W, C)`."""
    levels = drop_alpha(view).transpose(2, 0, 1).astype(np.float32, order="C")
    if np.issubdtype(view.dtype, np.integer):
        levels *= np.float32(255 / np.iinfo(view.dtype).max)
    return levels


def _blur(picture: NDArray[np.float32], deviation: float) -> NDArray[np.float32]:
    blurred: NDArray[np.float32] = ndimage.gaussian_filter(picture, deviation, axes=_AXES) if deviation else picture
    return blurred


def find_overlap(length: int, by: int) -> tuple[slice, slice]:
    """Returns where a line of pixels, looked up `by` pixels further along, has pixels: in the view, and in itself."""
    by = min(max(by, -length), length)
    low, high = max(0, -by), min(length, length - by)
    return slice(low, high), slice(low + by, high + by)


def _interpolate(picture: NDArray[np.float32], axis: int, fraction: float) -> NDArray[np.float32]:
    """Returns `picture` sampled `fraction` of a pixel further along `axis` by Keys's cubic convolution."""
    if fraction == 0:
        return picture
    shifted: NDArray[np.float32] = ndimage.correlate1d(
        picture, [0, *make_taps(np.array(fraction))], axis, mode="nearest"
    )
    return shifted
