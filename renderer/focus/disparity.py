"""The disparity of every pixel of a view, with its confidence.

A plane sweep compares the view with the others around it at each of some disparities; semi-global matching
(Hirschmueller, PAMI 30, 2008) lets a pixel agree with its neighbours, across edges less; a parabola through the best
three planes gives the fraction. Something in front may hide a pixel from the views on one side, so the views left,
right, above and below are compared by themselves too, and the half that agrees best decides. All of them together keep
outlines sharp.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.errors import InvalidOption
from ciir.renderer.focus.matching import match
from ciir.renderer.focus.planes import Spectra
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.light_field import DepthSense, LightField
    from ciir.renderer.views import View

SIDE = 5
"""Views along v and along u that are compared, spread over the grid: more cost time and gain nothing."""
STEP = 0.8
"""Pixels by which the outermost view moves from one plane to the next."""
MOST_PLANES = 96
COARSE = 96
"""Pixels along the longer side of the pictures in which the range of disparities is found."""
MOST_DIFFERENCE = 8.0
"""8-bit levels: larger differences are as wrong as this one."""


@dataclass(frozen=True, eq=False)
class DisparityMap:
    """The disparity of each pixel of a view."""

    view: View
    disparity: NDArray[np.float32]
    """`(H, W)`: by how many pixels a point moves to the left from one view to the next on the right.

    With the depth sense `cameras` larger is nearer, as in the HCI benchmark; with `lenses` larger is farther.
    """
    confidence: NDArray[np.float32]
    """`(H, W)`, 0 to 1: how much better the best plane fits than the usual one."""
    planes: NDArray[np.float64]
    """`(n,)`: the disparities that were compared; the fit goes between them."""
    depth_sense: DepthSense
    """Of the light field."""

    @property
    def hci(self) -> NDArray[np.float32]:
        """The disparity in the sense of the HCI benchmark, larger is nearer: as with the depth sense `cameras`."""
        return self.disparity if self.depth_sense == "cameras" else -self.disparity


def estimate_disparity(
    light_field: LightField, view: View | None = None, *, limits: tuple[float, float] | None = None
) -> DisparityMap:
    """The disparity of `view`, by default the centre one.

    `limits`: the least and the largest disparity in pixels a view, by default found from the pictures.

    Raises `InvalidOption` for a single view, and for limits that are not in order.
    """
    views = light_field.views
    if views.shape[0] * views.shape[1] < 2:
        raise InvalidOption("disparity: one view shows no depth; give a light field with two views or more")
    view = view or center_view(*views.shape[:2])
    rows, cols = (_spread(count, at) for count, at in zip(views.shape[:2], view, strict=True))
    levels = _read_levels(views[np.ix_(rows, cols)])
    place = int(np.searchsorted(rows, view[0])), int(np.searchsorted(cols, view[1]))
    offsets = rows - view[0], cols - view[1]
    if limits is None:
        limits = _find_limits(levels, place, offsets)
    elif not limits[0] < limits[1]:
        raise InvalidOption(f"limits: {limits[0]:g} to {limits[1]:g} is no range; give the smaller disparity first")
    reach = max(int(np.abs(along).max()) for along in offsets)
    planes = np.linspace(*limits, int(np.clip((limits[1] - limits[0]) * reach / STEP, 8, MOST_PLANES - 1)) + 1)
    disparity, confidence = match(_sweep(levels, place, offsets, planes), levels[place], planes)
    disparity = ndimage.median_filter(disparity, 3, mode="nearest")
    return DisparityMap(view, disparity.astype(np.float32), confidence, planes, light_field.depth_sense)


def _spread(count: int, at: int) -> NDArray[np.int64]:
    """At most `SIDE` of `count` indices, `at` among them, spread evenly."""
    spread = np.linspace(0, count - 1, min(SIDE, count)).round().astype(np.int64)
    spread[np.abs(spread - at).argmin()] = at
    return spread


def _read_levels(views: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float32]:
    """`(k, l, H, W, C)` in 8-bit levels, without alpha."""
    colours = 1 if views.shape[4] < 3 else 3
    return views[..., :colours].astype(np.float32) * np.float32(255 / np.iinfo(views.dtype).max)


def _sweep(
    levels: NDArray[np.float32],
    place: View,
    offsets: tuple[NDArray[np.int64], NDArray[np.int64]],
    planes: NDArray[np.float64],
) -> NDArray[np.float32]:
    """How badly each plane fits each pixel, `(planes, H, W)`."""
    own = levels[place].transpose(2, 0, 1)  # (C, H, W)
    colours = len(own)
    squares = np.square(levels).sum(axis=4, keepdims=True)
    stacked = np.concatenate([levels, squares / 256], axis=4)  # the squares in the same range, for the transforms
    spectra = Spectra(stacked, offsets, float(np.abs(planes).max()))
    squared = np.square(own).sum(axis=0)

    def compare(weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """The mean square difference between the view and those of `weights`, `(planes, H, W)`."""
        cost = np.empty((len(planes), *own.shape[1:]), np.float32)
        for number, mean in enumerate(spectra.add_planes(planes, weights)):
            cost[number] = 256 * mean[colours] + squared - 2 * np.einsum("chw,chw->hw", mean[:colours], own)
        return np.maximum(cost, 0, out=cost)

    def limit(cost: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.minimum(np.sqrt(cost / colours), MOST_DIFFERENCE)

    with ThreadPoolExecutor(2) as pool:
        halves = list(pool.map(compare, _make_halves(*offsets)))
        every = np.add.reduce(halves) / len(halves)
    return limit(np.minimum.reduce(halves)) + 2 * limit(every)


def _make_halves(along_v: NDArray[np.int64], along_u: NDArray[np.int64]) -> list[NDArray[np.float32]]:
    """Weights of the views on each side of the one that is compared, where there are any; together all count alike."""
    v, u = np.meshgrid(along_v, along_u, indexing="ij")
    halves = [np.where(side == 0, 0.5, side > 0).astype(np.float32) for side in (u, -u, v, -v)]
    for half in halves:
        half[(v == 0) & (u == 0)] = 0
    return [half for half in halves if half.any()]


def _find_limits(
    levels: NDArray[np.float32], place: View, offsets: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> tuple[float, float]:
    """The range of disparities, from a sweep over small pictures, with the next views alone."""
    height, width = levels.shape[2:4]
    factor = max(1, -(-max(height, width) // COARSE))
    rows, cols = (slice(max(0, at - 1), at + 2) for at in place)
    near = levels[rows, cols, : height // factor * factor, : width // factor * factor]
    blocks = (*near.shape[:2], height // factor, factor, width // factor, factor, near.shape[4])
    small, centre = near.reshape(blocks).mean(axis=(3, 5)), (place[0] - rows.start, place[1] - cols.start)
    along = offsets[0][rows], offsets[1][cols]
    most = max(small.shape[2:4]) / 4 / max(int(np.abs(places).max()) for places in along)
    planes = np.linspace(-most, most, MOST_PLANES + 1)
    disparity, confidence = match(_sweep(small, centre, along, planes), small[centre], planes)
    low, high = np.quantile(disparity[confidence >= np.median(confidence)], (0.005, 0.995))
    margin = (planes[1] - planes[0]) / 2
    return factor * float(low - margin), factor * float(high + margin)
