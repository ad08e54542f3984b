"""Depth planes by shift and sum: the mean of all views, each shifted so that one depth lines up.

A point of disparity m moves by m pixels to the left, and up, from one view to the next on the right, and below. So the
pixels that see a point of the plane of disparity m lie on lines `x + m*(u - t) = X`, `y + m*(v - s) = Y` of the light
field, and the plane, as seen from view (s, t), is the mean along them. In front of a lens array m = delta * distance /
pitch (`renderer.focus.depth_scale`). With `w` the views' weights, `y = Y - m*(v - s)` and `x = X - m*(u - t)`, all
methods compute

    P[Y, X] = sum of w[v, u] * W(y) * W(x) * L[v, u](y, x)  over the views v, u that have a pixel within half of (y, x)

divided by the same sum of ones in place of L, so that uneven coverage doesn't show (Hong, Jang and Javidi, Opt. Express
12, 2004; Ng et al. 2005). They differ in the window W, and in how views are sampled between pixels:

- `mapping`: each pixel is mapped back to the plane by interpolation (Shin and Yoo, Opt. Express 17, 2009) with a sinc
  of six pixels (`kernels.make_sinc_taps`), where a view ends by repeating its last pixel; W = 1. For views of parallel
  rays, back projection of magnified elemental images and their mean is the same sum.
- `window`: the same with a smooth window on each picture (Yoo, Opt. Lett. 36, 2011; Sensors 23, 5468, 2023): W falls
  linearly from 1 in the middle of a view to `BORDER` at its sides, so that views don't end in steps. The pictures of a
  camera array are its elemental images; in front of a lens array a window on those is an aperture (`apertures`).
- `delta`: the picture of all views side by side is convolved with an array of delta functions (Jang, Shin and Kim, Opt.
  Express 22, 2014), whose period is m short of a view. Pixels are not interpolated: the nearest counts, so close
  disparities may give the same plane. If the count of views is even, the plane may lie half a pixel off the middle of
  the grid.

Shifts are separable, so the views are shifted down and added along the columns of the grid, and the sums are then
shifted across and added. Each step is the product of a sparse matrix and pictures, for many planes at a time.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from math import ceil
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from scipy import sparse

from ciir.cores import count_available_cores
from ciir.errors import InvalidOption
from ciir.renderer.focus.apertures import check_weights
from ciir.renderer.focus.kernels import REACH, make_sinc_taps

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    Numbers = Sequence[float] | NDArray[np.float64]

Method = Literal["mapping", "window", "delta"]

BORDER = 1 / 8
"""The least weight of a place in a view with the method `window`."""
MEMORY = 2**28
"""Approximate bytes of the sums between the two steps, which set how many planes are made at a time."""
LEAST_ALPHA = 0.5
"""Half a level: colours are not divided by less, because interpolation may leave that much where there is nothing."""
_NUMBERS = 450
"""Most numbers in the rows that one product adds, few enough for the processor's cache."""
_EXACT = 257
"""Most 8-bit pixels whose sum fits 16 bits."""


def refocus(
    views: NDArray[Any],
    disparities: Numbers,
    *,
    method: Method = "mapping",
    weights: NDArray[np.float32] | None = None,
) -> Iterator[NDArray[np.float32]]:
    """Makes a plane for each of `disparities`, in pixels per view, as the middle of the grid sees it: `(H, W, C)`, in
    the units of the views.

    `views`: `(V, U, H, W, C)`. `weights`: `(V, U)`, one for each view, by default 1: the aperture. Where a view does
    not reach, only the others count; a pixel that no view reaches is 0. Colours count by alpha, if there are 2 or 4
    channels.

    Raises `InvalidOption` for an unknown method, for weights that `check_weights` refuses, and for disparities that are
    not finite.
    """
    if method not in get_args(Method):
        raise InvalidOption(f"method: {method!r} is not known; give {', '.join(get_args(Method))}")
    numbers = read_disparities(disparities)
    weights = check_weights(weights, views.shape[:2])
    if views.shape[4] in (2, 4) and (views[..., -1] != views[..., -1].max()).any():
        return map(_divide_by_alpha, _make_planes(_multiply_by_alpha(views), numbers, weights, method))
    return _make_planes(views, numbers, weights, method)


def _multiply_by_alpha(views: NDArray[Any]) -> NDArray[np.float32]:
    """Multiplies colours by alpha, so that hidden colours don't count."""
    weighted = views.astype(np.float32)
    weighted[..., :-1] *= weighted[..., -1:]
    return weighted


def _divide_by_alpha(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Divides colours by alpha again; they are 0 where there is nothing."""
    alpha = plane[..., -1:]
    plane[..., :-1] *= (alpha > 0) / np.maximum(alpha, LEAST_ALPHA)
    return plane


def read_disparities(disparities: Iterable[float] | NDArray[np.floating]) -> NDArray[np.float64]:
    """Returns a list, an array, a tensor or anything else that gives finite numbers one by one, as `(n,)`.

    Raises `InvalidOption` for anything else.
    """
    try:
        numbers = np.asarray(disparities if hasattr(disparities, "__array__") else list(disparities))
    except (TypeError, ValueError):  # no iterable, or one of rows of unequal lengths
        numbers = np.empty((), object)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iuf" or not np.isfinite(numbers).all():
        raise InvalidOption("disparities: give finite numbers, in pixels per view, such as [-0.5, 0.25]")
    return numbers.astype(np.float64)


def check_overlap(disparities: Numbers, side: int) -> None:
    """Raises `InvalidOption` for disparities at which views of `side` pixels along their longer side don't overlap."""
    most = np.abs(disparities).max(initial=0)
    if not most <= side:
        raise InvalidOption(
            f"disparity: {most:g} pixels are over the {side} of a view, so that no views overlap; give less, or "
            "another depth"
        )


def _make_planes(
    views: NDArray[Any], disparities: NDArray[np.float64], weights: NDArray[np.float32], method: Method
) -> Iterator[NDArray[np.float32]]:
    count_v, count_u, height, width, channels = views.shape
    batch = max(1, MEMORY // (4 * count_u * height * width * channels))
    for start in range(0, len(disparities), batch):
        some = disparities[start : start + batch]
        down, across = _Shifts(some, count_v, height, method), _Shifts(some, count_u, width, method)
        reached = _count_views(weights, down.reach, across.reach)
        for plane, reach in zip(_add_views(views, weights, down, across), reached, strict=True):
            yield plane / np.where(reach > 0, reach, 1)[..., np.newaxis]


def _count_views(
    weights: NDArray[np.float32], down: NDArray[np.float32], across: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns what `_add_views` gives for views of ones, `(planes, H, W)`."""
    rows, which = np.unique(weights, axis=0, return_inverse=True)  # few: apertures are symmetric
    counts = np.zeros((len(down), down.shape[2], across.shape[2]), np.float32)
    for index, row in enumerate(rows):
        counts += np.einsum("py,px->pyx", down[:, which == index].sum(axis=1), np.einsum("pux,u->px", across, row))
    return counts


def _add_views(
    views: NDArray[Any], weights: NDArray[np.float32], down: _Shifts, across: _Shifts
) -> NDArray[np.float32]:
    """Returns the sums of all shifted views, `(planes, H, W, C)`."""
    count_u, height, width, channels = views.shape[1:]
    planes = len(down.reach)
    matrices = [down.make_matrix(slice(None)), *(across.make_matrix(slice(p, p + 1)) for p in range(planes))]
    factors = [weights, *(matrix.data for matrix in matrices)]
    is_exact = views.dtype == np.uint8 and weights.size <= _EXACT and all(np.isin(f, (0, 1)).all() for f in factors)
    dtype = np.uint16 if is_exact else np.float32
    weights, (first, *second) = weights.astype(dtype), (matrix.astype(dtype, copy=False) for matrix in matrices)
    sums = np.empty((planes, count_u, width, channels, height), dtype)
    result = np.empty((planes, height, width, channels), np.float32)

    def add_down(u: int, cols: slice) -> None:
        pixels: NDArray[Any] = views[:, u, :, cols].transpose(0, 1, 3, 2).astype(dtype, order="C")  # (V, H, C, cols)
        pixels *= weights[:, u, np.newaxis, np.newaxis, np.newaxis]
        moved = (first @ pixels.reshape(first.shape[1], -1)).reshape(height, planes, channels, -1)
        for plane, total in enumerate(sums):
            total[u, cols] = moved[:, plane].T

    def add_across(plane: int) -> None:
        moved = second[plane] @ sums[plane].reshape(-1, channels * height)
        result[plane] = moved.reshape(width, channels, height).transpose(2, 0, 1)

    step = ceil(width / ceil(width * channels / _NUMBERS))
    strips = [slice(start, start + step) for start in range(0, width, step)]
    with ThreadPoolExecutor(count_available_cores()) as pool:
        list(pool.map(add_down, *zip(*product(range(count_u), strips), strict=True)))
        list(pool.map(add_across, range(planes)))
    return result


class _Shifts:
    """Views along one axis of the grid, moved so that each of some planes lines up."""

    def __init__(self, disparities: NDArray[np.float64], views: int, length: int, method: Method) -> None:
        """`views`, each of `length` pixels along this axis."""
        shifts = np.round(np.multiply.outer(disparities, np.arange(views) - (views - 1) / 2), 9)
        shifts = np.clip(np.floor(shifts + 0.5) if method == "delta" else shifts, -length - 1, length + 1)
        whole = np.floor(shifts)
        places = np.arange(length) - shifts[..., np.newaxis]
        self.reach = ((places >= -0.5) & (places < length - 0.5)) * np.float32(1)
        """`(planes, views, length)`: how much a view counts at each pixel."""
        if method == "window":
            self.reach *= BORDER + (1 - BORDER) * (1 - np.abs(2 * places + 1 - length) / length).clip(0)
        self._taps = make_sinc_taps(shifts - whole)
        before = (np.arange(length) - whole[..., np.newaxis])[..., np.newaxis] - np.arange(1 - REACH, REACH + 1)
        self._sources = before.clip(0, length - 1) + length * np.arange(views)[:, np.newaxis, np.newaxis]

    def make_matrix(self, planes: slice) -> sparse.csr_array:
        """Returns the matrix that moves views, `(views * length, ...)`, and adds them: to `(length * planes, ...)`."""
        taps = self._taps[planes, :, np.newaxis] * self.reach[planes, ..., np.newaxis]  # (planes, views, length, 6)
        rows, (views, length) = taps.shape[0] * taps.shape[2], taps.shape[1:3]
        numbers, sources = (part.transpose(2, 0, 1, 3).reshape(rows, -1) for part in (taps, self._sources[planes]))
        is_used = numbers != 0
        starts = np.concatenate([[0], np.cumsum(is_used.sum(axis=1))])
        return sparse.csr_array(
            (numbers[is_used].astype(np.float32), sources[is_used].astype(np.int32), starts.astype(np.int32)),
            shape=(rows, views * length),
        )
