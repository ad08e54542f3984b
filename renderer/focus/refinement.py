"""Disparity from noisy views: all views together correct a map that few of them gave.

Looked up along a pixel's disparity that is wrong by e, the view at (v, u) from the wanted one differs from the mean of
all by e * (v*Iy + u*Ix). Least squares over all views (Lucas and Kanade, IJCAI 1981) have the least variance that
unbiased estimates can have; views that show something else count less. Pixels then share what they show with their
neighbours, each by its variance, not across steps of the map (weighted least squares, Farbman et al., SIGGRAPH 2008).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import cg

from ciir.renderer.focus.sweep import read_levels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.views import View

    Picture = NDArray[np.float32]

MOST_VIEWS = 9
"""Rows, and columns, of views that are used."""
ROUNDS = 2
"""Corrections, each of the one before."""
BLUR = 0.8
"""Standard deviation in pixels: a wrong disparity has to move a view by less than its details measure."""
SMOOTHNESS = 300.0
"""Of the disparity, in pixels to the power of -2: how much two neighbours that agree count beside what they show."""
STEP = 0.1
"""Pixels between neighbours that lower it by e."""
ROWS = 32
"""Of pixels, that are computed at a time."""


def refine(views: NDArray[Any], view: View, disparity: Picture, noise: float) -> Picture:
    """`disparity` `(H, W)` of `view`, corrected with all views `(V, U, H, W, C)` at most half the grid away.

    `noise`: its standard deviation, in 8-bit levels.
    """
    farthest = max(views.shape[:2]) // 2
    rows, cols = (
        _thin(max(0, at - farthest), min(count, at + farthest + 1))
        for count, at in zip(views.shape, view, strict=False)
    )
    places = [(int(v), int(u)) for v in rows for u in cols]
    offsets = np.array(places, np.float32) - np.array(view, np.float32)
    with ThreadPoolExecutor(2) as pool:
        levels = pool.map(lambda place: read_levels(views[place]), places)
        pictures = list(pool.map(lambda picture: ndimage.gaussian_filter(picture, BLUR, axes=(1, 2)), levels))
        for _ in range(ROUNDS):
            parts = [slice(at, at + ROWS) for at in range(0, len(disparity), ROWS)]
            found = list(pool.map(partial(_correct, pictures, offsets, disparity, noise), parts))
            error, information = (np.concatenate(some) for some in zip(*found, strict=True))
            disparity = _smooth(disparity, error, information)
    return disparity


def _thin(start: int, stop: int) -> NDArray[np.int64]:
    """At most `MOST_VIEWS` of the rows or columns from `start` to before `stop`."""
    return np.unique(np.linspace(start, stop - 1, min(MOST_VIEWS, stop - start)).round().astype(int))


def _correct(
    pictures: list[Picture], offsets: Picture, disparity: Picture, noise: float, part: slice
) -> tuple[Picture, Picture]:
    """For some rows, `(h, W)` each: the error times the information, and the information, the variance's inverse.

    `pictures`: n of `(C, H, W)`. `offsets`: `(n, 2)`, where they stand from the wanted view.
    """
    height, width = disparity.shape
    start, stop = max(0, part.start - 1), min(height, part.stop + 1)  # with neighbours, for gradients
    map_ = disparity[start:stop]
    y, x = np.arange(start, stop, dtype=np.float32)[:, np.newaxis], np.arange(width, dtype=np.float32)
    looked_up = np.empty((len(pictures), len(pictures[0]), *map_.shape), np.float32)
    is_inside = np.empty((len(pictures), *map_.shape), np.float32)
    for number, (v, u) in enumerate(offsets):
        at = np.stack([y - v * map_, x - u * map_])
        is_inside[number] = ((at >= 0).all(axis=0)) & (at[0] <= height - 1) & (at[1] <= width - 1)
        for picture, result in zip(pictures[number], looked_up[number], strict=True):
            ndimage.map_coordinates(picture, at, result, order=1, mode="nearest")
    weights = is_inside
    for _ in range(2):  # the second mean is of views that agree with the first
        weights = _weigh(looked_up, weights, is_inside, noise)
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


def _weigh(looked_up: Picture, weights: Picture, is_inside: Picture, noise: float) -> Picture:
    """Less for pixels that are far from the mean of all views, `(n, h, W)`: something else hides the point there."""
    mean = _average(looked_up, weights)[1]
    squares = np.zeros_like(weights)
    for channel in range(len(mean)):
        squares += np.square(looked_up[:, channel] - mean[channel])
    squares = ndimage.uniform_filter(squares / len(mean), 3, axes=(1, 2))
    usual = (noise / 2) ** 2 + 9  # the blur halves the noise at least; 3 levels for what the map's error does
    result: Picture = is_inside / (1 + np.square(squares / usual))
    return result


def _average(looked_up: Picture, weights: Picture) -> tuple[Picture, Picture]:
    """The sum of the weights `(h, W)` and the mean `(C, h, W)`."""
    total = np.maximum(weights.sum(axis=0), 1e-3)
    return total, np.einsum("nhw,nchw->chw", weights, looked_up) / total


def _smooth(disparity: Picture, error: Picture, information: Picture) -> Picture:
    """The map d that minimises the sum of `information * (d - disparity)**2 - 2 * error * (d - disparity)` and of the
    squared steps between neighbours times `SMOOTHNESS`, less where `disparity` has a step.
    """
    down, right = (SMOOTHNESS * np.exp(np.abs(np.diff(disparity, axis=axis, append=np.inf)) / -STEP) for axis in (0, 1))
    information = information + 1e-3  # where nothing is seen, the map stays
    diagonal = information + down + right + np.roll(down, 1, 0) + np.roll(right, 1, 1)
    width = disparity.shape[1]
    beside, below = -right.ravel()[:-1], -down.ravel()[:-width]
    matrix = sparse.diags_array([diagonal.ravel(), beside, beside, below, below], offsets=[0, 1, -1, width, -width])
    known = (error + information * disparity).ravel()
    found, _ = cg(
        matrix.tocsr(), known, disparity.ravel(), rtol=1e-6, maxiter=100, M=sparse.diags_array(1 / diagonal.ravel())
    )
    result: Picture = found.reshape(disparity.shape).astype(np.float32)
    return result
