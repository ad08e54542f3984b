"""Corrects a disparity map, which few views gave, with all views together; maps of noisy views gain most.

If a pixel's disparity is wrong by e, the view at (v, u) from the wanted one, looked up along it, differs from the mean
of all by e * (v*Iy + u*Ix). Least squares over all views (Lucas and Kanade, IJCAI 1981) have the least variance that
unbiased estimates can have; views that show something else count less. Pixels then share what they show with their
neighbours, each according to its variance, but not across steps of the map (weighted least squares, Farbman et al.,
SIGGRAPH 2008). Blurred views find what is far off where texture is weak; sharp ones come last and do not mix both sides
of an outline.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import ndimage

from ciir.renderer.focus.stereo.conjugate_gradients import solve
from ciir.renderer.focus.stereo.sweep import read_levels
from ciir.renderer.views import spread_indices

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.views import View

    Picture = NDArray[np.float32]

MOST_VIEWS = 9
"""Rows, and columns, of views that are used."""


class Round(NamedTuple):
    """One correction of the map."""

    blur: float
    """Blur of the views, standard deviation in pixels: an error has to move a view by less than the size of its
    details."""
    smoothness: float
    """Smoothness of the disparity, in pixels to the power of -2: how much agreeing neighbours count next to what they
    show."""
    slopes: bool
    """Whether neighbours agree if they differ by the slope around them, rather than if they are equal."""


FIRST = tuple(Round(blur, 300.0, slopes=True) for blur in (1.5, 0.8, 0.3))
"""Corrections of maps with large errors."""
LAST = Round(0.3, 300.0, slopes=True), Round(0.3, 100.0, slopes=False)
"""Corrections of outlines, near which slopes are wrong."""
CLEAN = (Round(0.3, 300.0, slopes=True),)
"""Corrections of maps of clean views, which are wrong by fractions of a plane."""
STEP = 0.1
"""Difference between neighbours, in pixels, that lowers the smoothness by a factor of e."""
SLOPE = 3.0
"""Standard deviation in pixels of the Gaussian window whose steps are a slope."""
STEPS = 100
"""Most steps of conjugate gradients."""
ROWS = 32
"""Rows of pixels that are computed at a time."""
AROUND = 3
"""Rows on each side that they depend on: through a gradient, and through the window of each of two weightings."""


def refine(
    views: NDArray[Any],
    view: View,
    disparity: Picture,
    noise: float,
    rounds: Iterable[Round] = (*FIRST, *LAST),
    *,
    own: Picture | None = None,
    most: int = MOST_VIEWS,
    order: int = 1,
) -> Picture:
    """Returns `disparity` `(H, W)` of `view`, corrected with `most` rows and columns of the views `(V, U, H, W, C)`
    that `select_views` picks.

    `noise`: its standard deviation, in 8-bit levels. `own`: the view with less noise, `(C, H, W)` in 8-bit levels;
    views that differ from it count less. Without `own`, views that differ from the mean of all count less. `order`:
    that of the splines between pixels, 1 or 3. Lines blur fine texture, so that disparities between planes come out up
    to 0.03 pixels too far from those planes; with cubic splines it is less than half of that, but a map takes 40 % more
    time.
    """
    rows, cols = select_views(views.shape[:2], view, most)
    places = [(int(v), int(u)) for v in rows for u in cols]
    offsets = np.array(places, np.float32) - np.array(view, np.float32)

    def read(place: View, blur: float) -> Picture:
        picture: Picture = ndimage.gaussian_filter(read_levels(views[place]), blur, axes=(1, 2))
        for axis in (1, 2) if order > 1 else ():
            picture = ndimage.spline_filter1d(picture, order, axis, np.float32)
        return picture

    parts = [slice(at, at + ROWS) for at in range(0, len(disparity), ROWS)]
    with ThreadPoolExecutor(2) as pool:
        for one in rounds:
            pictures = list(pool.map(partial(read, blur=one.blur), places))
            shown = None if own is None else ndimage.gaussian_filter(own, one.blur, axes=(1, 2))
            correct = partial(_correct, pictures, offsets, disparity, noise, own=shown, order=order)
            found = list(pool.map(correct, parts))
            error, information = (np.concatenate(some) for some in zip(*found, strict=True))
            disparity = _smooth(disparity, error, information, one)
    return disparity


def select_views(
    grid: tuple[int, ...], view: View, most: int = MOST_VIEWS
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns rows and columns of the `grid` at most half of it away from `view`: up to `most` of each, evenly
    spread.
    """
    farthest = max(grid) // 2
    ranges = ((max(0, at - farthest), min(count, at + farthest + 1)) for count, at in zip(grid, view, strict=True))
    rows, cols = (spread_indices(start, stop, most) for start, stop in ranges)
    return rows, cols


def _correct(
    pictures: list[Picture],
    offsets: Picture,
    disparity: Picture,
    noise: float,
    part: slice,
    *,
    own: Picture | None,
    order: int,
) -> tuple[Picture, Picture]:
    """Returns, for some rows, the error times the information, and the information, the variance's inverse: `(h, W)`
    each.

    `pictures`: n of `(C, H, W)`, the coefficients of splines. `offsets`: `(n, 2)`, their position relative to the
    wanted view. `own`, `order`: as in `refine`.
    """
    height, width = disparity.shape
    start, stop = max(0, part.start - AROUND), min(height, part.stop + AROUND)
    map_ = disparity[start:stop]
    y, x = np.arange(start, stop, dtype=np.float32)[:, np.newaxis], np.arange(width, dtype=np.float32)
    looked_up = np.empty((len(pictures), len(pictures[0]), *map_.shape), np.float32)
    is_inside = np.empty((len(pictures), *map_.shape), np.float32)
    for number, (v, u) in enumerate(offsets):
        at = np.stack([y - v * map_, x - u * map_])
        is_inside[number] = ((at >= 0).all(axis=0)) & (at[0] <= height - 1) & (at[1] <= width - 1)
        for picture, result in zip(pictures[number], looked_up[number], strict=True):
            ndimage.map_coordinates(picture, at, result, order=order, mode="mirror", prefilter=False)
    if own is None:
        weights = is_inside
        for _ in range(2):  # the second mean is over views that agree with the first
            weights = _weigh(looked_up, _average(looked_up, weights)[1], is_inside, noise)
    else:
        weights = _weigh(looked_up, own[:, start:stop], is_inside, noise)
    total, mean = _average(looked_up, weights)
    gradient = np.array(np.gradient(mean, axis=(1, 2)))  # (2, C, h, W)
    first = np.einsum("nhw,ni->ihw", weights, offsets)
    second = np.einsum("nhw,nij->ijhw", weights, np.einsum("ni,nj->nij", offsets, offsets))
    second -= first * first[:, np.newaxis] / total
    weighted = weights[:, np.newaxis] * looked_up
    slopes = np.einsum("nchw,ni->ichw", weighted, offsets) - first[:, np.newaxis] * mean
    error = np.einsum("ichw,ichw->hw", gradient, slopes)
    information = np.einsum("ijhw,ijhw->hw", np.einsum("ichw,jchw->ijhw", gradient, gradient), second)
    kept = slice(part.start - start, part.start - start + ROWS)
    return error[kept] / noise**2, information[kept] / noise**2


def _weigh(looked_up: Picture, shown: Picture, is_inside: Picture, noise: float) -> Picture:
    """Returns weights that are lower for pixels far from what is shown, `(C, h, W)`: something else hides the point
    there.
    """
    squares = np.zeros_like(is_inside)
    for channel in range(len(shown)):
        squares += np.square(looked_up[:, channel] - shown[channel])
    squares = ndimage.uniform_filter(squares / len(shown), 3, axes=(1, 2))
    usual = (noise / 2) ** 2 + 9  # the blur at least halves the noise; 3 levels are for the map's error
    result: Picture = is_inside / (1 + np.square(squares / usual))
    return result


def _average(looked_up: Picture, weights: Picture) -> tuple[Picture, Picture]:
    """Returns the sum of the weights `(h, W)` and the mean `(C, h, W)`."""
    total = np.maximum(weights.sum(axis=0), 1e-3)
    return total, np.einsum("nhw,nchw->chw", weights, looked_up) / total


def _smooth(disparity: Picture, error: Picture, information: Picture, one: Round) -> Picture:
    """Returns the map d that minimises the sum of `information * (d - disparity)**2 - 2 * error * (d - disparity)` and
    of the smoothness times the squared steps between neighbours, minus the slopes. The smoothness is lower where
    `disparity` has a step.
    """
    diagonal = information.astype(np.float64) + 1e-3  # keeps the map where nothing is seen
    known = error + diagonal * disparity
    weights = []
    for axis in (0, 1):
        steps = np.diff(disparity.astype(np.float64), axis=axis)
        slope = _average_steps(steps) if one.slopes else np.zeros_like(steps)
        weight = one.smoothness * np.exp(np.abs(steps - slope) / -STEP)
        behind = ((0, int(axis == 0)), (0, int(axis == 1)))  # the last pixel has no next one
        weight, slope = np.pad(weight, behind), np.pad(slope, behind)
        diagonal += weight + np.roll(weight, 1, axis)
        known += np.roll(weight * slope, 1, axis) - weight * slope
        weights.append(weight)

    def apply(x: NDArray[np.float64]) -> NDArray[np.float64]:
        map_ = x.reshape(disparity.shape)
        result = diagonal * map_
        for axis, weight in enumerate(weights):
            result -= weight * np.roll(map_, -1, axis) + np.roll(weight * map_, 1, axis)
        return result.ravel()

    wanted = known.ravel() - apply(disparity.ravel().astype(np.float64))
    change = solve(apply, wanted, diagonal.ravel(), steps=STEPS, tolerance=1e-6)
    result: Picture = disparity + change.reshape(disparity.shape).astype(np.float32)
    return result


def _average_steps(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the mean of the steps around each pixel, with less weight for large ones."""
    weights = np.exp(np.abs(steps) / -STEP)
    total, count = (ndimage.gaussian_filter(part, SLOPE) for part in (weights * steps, weights))
    result: NDArray[np.float64] = total / np.maximum(count, 1e-6)
    return result
