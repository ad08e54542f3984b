"""Depth planes by shift and sum: the mean of all views, each shifted so that one depth lines up.

A point of disparity m moves by m pixels to the left, and up, from one view to the next on the right, and below. So the
pixels that see a point of the plane of disparity m lie on lines `x + m*(u - t) = X`, `y + m*(v - s) = Y` of the light
field, and the plane, as seen from view (s, t), is the mean along them. In front of a lens array m = delta * distance /
pitch (`renderer.focus.depth_scale`). With `w` the views' weights, all methods are

    P[Y, X] = sum of w[v, u] * W[y, x] * k(Y - y - m*(v - s)) * k(X - x - m*(u - t)) * L[v, u, y, x]  over v, u, y, x,

divided by the same sum of ones in place of L, so that uneven coverage doesn't show (Hong, Jang and Javidi, Opt. Express
12, 2004; Ng et al. 2005). They differ in the kernel k and the window W:

- `mapping`: each pixel is mapped back to the plane, by interpolation (Shin and Yoo, Opt. Express 17, 2009): k is Keys's
  cubic convolution with a = -1/2, and W = 1. For views of parallel rays, back projection of magnified elemental images
  and their mean is the same sum.
- `window`: the same with a smooth window on each picture (Yoo, Opt. Lett. 36, 2011; Sensors 23, 5468, 2023): W falls
  linearly from 1 in the middle of a view to `BORDER` at its sides, so that views don't end in steps. The pictures of a
  camera array are its elemental images; in front of a lens array a window on those is an aperture (`apertures`).
- `delta`: the picture of all views side by side is convolved with an array of delta functions (Jang, Shin and Kim, Opt.
  Express 22, 2014), whose period is m short of a view. Pixels are not interpolated: k is 1 at the nearest whole pixel,
  so close disparities may give the same plane. Where the count of views is even, the plane may lie half a pixel off the
  middle of the grid.

The sums are done in the frequency domain, where the shift of a view is one factor for each frequency: the sum over the
views of a row is one matrix product for all planes. Pictures are padded, so that nothing wraps around, and kernels are
local ones, so that edges don't ring.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from scipy import fft

from ciir.errors import InvalidOption
from ciir.renderer.focus.apertures import check_weights
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    Numbers = Sequence[float] | NDArray[np.float64]

Method = Literal["mapping", "window", "delta"]

BORDER = 1 / 8
"""The least weight of a pixel with the method `window`: float32 still resolves its square, in corners."""
MEMORY = 2**27
"""Bytes, about, of the spectra of the planes that are computed at a time."""
KEPT = 2**29
"""Most bytes of the views' spectra that are kept; larger ones are computed again for each few planes."""
_PRODUCT = 2**16
"""Most multiplications in one matrix product: OpenBLAS splits larger ones between threads, at a loss for shapes like
these."""
_LEAST = 1e-4
"""Share of the weights below which a pixel counts as not reached: the tails of the kernel alone."""


def refocus(
    views: NDArray[Any],
    disparities: Numbers,
    *,
    method: Method = "mapping",
    weights: NDArray[np.float32] | None = None,
) -> Iterator[NDArray[np.float32]]:
    """A plane for each of `disparities`, in pixels a view, as the middle of the grid sees it: `(H, W, C)`, in the units
    of the views.

    `views`: `(V, U, H, W, C)`. `weights`: `(V, U)`, of each view, by default 1: the aperture. Where a view does not
    reach, the others count alone; a pixel that no view reaches is 0.

    Raises `InvalidOption` for an unknown method, for weights that `check_weights` refuses, and for disparities that are
    not finite.
    """
    if method not in get_args(Method):
        raise InvalidOption(f"method: {method!r} is not known; give {', '.join(get_args(Method))}")
    check_disparities(disparities)
    weights = check_weights(weights, views.shape[:2])
    most = float(np.abs(disparities).max(initial=0))
    planes = _Spectra(views, most, method).add_planes(disparities, weights)
    return (np.ascontiguousarray(plane.transpose(1, 2, 0)) for plane in planes)


def check_disparities(disparities: Numbers) -> None:
    """Raises `InvalidOption` for anything but a row of finite numbers."""
    numbers = np.asarray(disparities)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iuf" or not np.isfinite(numbers).all():
        raise InvalidOption("disparities: give finite numbers, in pixels a view, as in [-0.5, 0.25]")


class _Spectra:
    """The Fourier transforms of all views, of which planes are made."""

    def __init__(self, views: NDArray[Any], most: float, method: Method) -> None:
        """`views`: `(V, U, H, W, C)`. `most`: the largest disparity, without its sign, that planes will have."""
        self._views, self._workers = views, count_cores()
        self._along = [np.arange(count) - (count - 1) / 2 for count in views.shape[:2]]
        self._padded = [
            fft.next_fast_len(length + int(np.ceil(min(most * np.abs(places).max(), length + 2))) + 4, real=True)
            for length, places in zip(views.shape[2:4], self._along, strict=True)
        ]
        self._half = self._padded[1] // 2 + 1
        make_window = _make_window if method == "window" else np.ones
        self._windows = [make_window(length).astype(np.float32) for length in views.shape[2:4]]
        self._is_whole = method == "delta"
        self._offset = np.float32(views[center_view(*views.shape[:2])].mean())  # smaller sums: less rounding at borders
        size = 8 * views.shape[0] * views.shape[1] * views.shape[4] * self._padded[0] * self._half
        self._kept = [self._transform(row) for row in views] if size <= KEPT else None

    def add_planes(self, disparities: Numbers, weights: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
        """The mean of all views with their `weights` at each of `disparities`, `(C, H, W)`."""
        batch = max(1, MEMORY // (8 * self._views[0, 0].size))
        for start in range(0, len(disparities), batch):
            some = np.asarray(disparities[start : start + batch], np.float64)[:, np.newaxis]
            rows, cols = (
                _Shifts(self._limit(some * places, len(window)), window, padded)
                for places, window, padded in zip(self._along, self._windows, self._padded, strict=True)
            )
            reached = np.einsum("pvy,vu,pux->pyx", rows.reach, weights, cols.reach, optimize=True)
            for plane, reach in zip(self._add(rows, cols, weights), reached, strict=True):
                is_reached = reach > _LEAST * weights.sum()
                yield np.where(is_reached, self._offset + plane / np.where(is_reached, reach, 1), 0)

    def _limit(self, shifts: NDArray[np.float64], length: int) -> NDArray[np.float64]:
        """Shifts, whole where pixels are not interpolated, at most to just outside a view of `length` pixels."""
        return np.clip(np.floor(shifts + 0.5) if self._is_whole else shifts, -length - 2, length + 2)

    def _transform(self, row: NDArray[Any]) -> NDArray[np.complex64]:
        """The transforms of a row of views, `(half, C, U, padded)`: frequencies along x come first."""
        pictures = (row.transpose(3, 0, 1, 2) - self._offset) * np.multiply.outer(*self._windows)  # (C, U, H, W)
        spectra = fft.rfft(pictures, self._padded[1], workers=self._workers)
        result: NDArray[np.complex64] = fft.fft(
            np.ascontiguousarray(spectra.transpose(3, 0, 1, 2)), self._padded[0], workers=self._workers
        )
        return result

    def _add(self, rows: _Shifts, cols: _Shifts, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """The sums of all shifted views, `(planes, C, H, W)`."""
        count, channels = len(rows.factors), self._views.shape[4]
        sums = np.zeros((self._half, channels, count, self._padded[0]), np.complex64)
        most = max(1, _PRODUCT // (len(weights[0]) * self._padded[0]))
        for v, row_weights in enumerate(weights):
            if not row_weights.any():
                continue
            spectra = self._kept[v] if self._kept is not None else self._transform(self._views[v])
            factors = cols.factors[..., : self._half] * row_weights[:, np.newaxis]  # (planes, U, half)
            factors = np.ascontiguousarray(factors.transpose(2, 0, 1))[:, np.newaxis]
            for start in range(0, count, most):  # (half, 1, planes, U) @ (half, C, U, padded)
                part = slice(start, start + most)
                sums[:, :, part] += (factors[:, :, part] @ spectra) * rows.factors[part, v]
        columns = fft.ifft(sums, overwrite_x=True, workers=self._workers)[..., : rows.length]  # (half, C, planes, H)
        columns = np.ascontiguousarray(columns.transpose(2, 1, 3, 0))
        result: NDArray[np.float32] = fft.irfft(columns, self._padded[1], workers=self._workers)
        return result[..., : cols.length]


class _Shifts:
    """Shifts of signals of as many samples as `window` by `(planes, views)` pixels towards larger indices."""

    def __init__(self, shifts: NDArray[np.float64], window: NDArray[np.float32], padded: int) -> None:
        self.length = length = len(window)
        whole = np.floor(shifts)
        taps = make_taps(shifts - whole)  # (planes, views, 4), for offsets -1 to 2
        turns = np.exp(-2j * np.pi * (whole[..., np.newaxis] + np.arange(-1, 3))[..., np.newaxis] * fft.fftfreq(padded))
        self.factors = np.einsum("pkt,pktf->pkf", taps, turns).astype(np.complex64)
        """`(planes, views, frequencies)`."""
        inside = fft.fft(window, padded)
        self.reach = fft.ifft(self.factors * inside).real[..., :length].astype(np.float32)
        """`(planes, views, length)`: the share of the kernel that lies inside the view, times the window."""


def make_taps(fraction: NDArray[Any]) -> NDArray[Any]:
    """Weights of Keys's kernel (IEEE ASSP 29, 1981, equation 15) for a shift by `fraction`, 0 to 1, of a pixel."""
    distance = np.abs(fraction[..., np.newaxis] - np.arange(-1, 3))
    near = (1.5 * distance - 2.5) * distance**2 + 1
    far = ((-0.5 * distance + 2.5) * distance - 4) * distance + 2
    return np.where(distance <= 1, near, np.where(distance < 2, far, 0))


def _make_window(length: int) -> NDArray[np.float64]:
    """A triangle, `(length,)`, from `BORDER` at both ends to 1 in the middle."""
    places = np.arange(length) + 0.5
    window: NDArray[np.float64] = BORDER + (1 - BORDER) * np.minimum(places, length - places) / (length / 2)
    return window


def count_cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
