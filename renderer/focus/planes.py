"""Depth planes by shift and sum: the mean of all views, each shifted so that one depth lines up.

A point of disparity m moves by m pixels to the left, and up, from one view to the next on the right, and below. So a
plane of disparity m, seen from view (s, t), is the mean over views (v, u) of `L[v, u, y - m*(v - s), x - m*(u - t)]`
(Hong, Jang and Javidi, Opt. Express 12, 2004; Ng et al. 2005). In front of a lens array m = delta * distance / pitch.

Shifts by fractions of a pixel are Keys's cubic convolution (a = -1/2), done in the frequency domain, where the shift of
a view is one factor for each frequency: the sum over the views of a row is one matrix product for all planes. Pictures
are padded, so that nothing wraps around, and the kernel is a local one, so that edges don't ring.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import fft

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    Numbers = Sequence[float] | NDArray[np.float64]

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
    views: NDArray[Any], disparities: Numbers, *, weights: NDArray[np.float32] | None = None
) -> Iterator[NDArray[np.float32]]:
    """A plane for each of `disparities`, in pixels a view, as the middle of the grid sees it: `(H, W, C)`, in the units
    of the views.

    `views`: `(V, U, H, W, C)`. `weights`: `(V, U)`, of each view, by default 1: the aperture. Where a view does not
    reach, the others count alone; a pixel that no view reaches is 0.

    Raises `InvalidOption` for weights of another shape, below 0, or all 0, and for disparities that are not finite.
    """
    grid = views.shape[:2]
    if not np.isfinite(disparities).all():
        raise InvalidOption("disparities: some are not finite; give numbers, in pixels a view")
    along_v, along_u = (np.arange(count) - (count - 1) / 2 for count in grid)
    most = float(np.abs(disparities).max(initial=0))
    for plane in Spectra(views, (along_v, along_u), most).add_planes(disparities, check_weights(weights, grid)):
        yield np.ascontiguousarray(plane.transpose(1, 2, 0))


def check_weights(weights: NDArray[Any] | None, grid: tuple[int, ...]) -> NDArray[np.float32]:
    """The weights of views, by default all 1. Raises `InvalidOption` as `refocus`."""
    if weights is None:
        return np.ones(grid, np.float32)
    if weights.shape != grid or not np.isfinite(weights).all() or weights.min() < 0 or weights.max() == 0:
        raise InvalidOption(f"weights: give {grid[0]}x{grid[1]} numbers from 0, one for each view, not all of them 0")
    return weights.astype(np.float32)


def make_aperture(grid: tuple[int, ...], radius: float) -> NDArray[np.float32]:
    """Weights `(V, U)` of the views within `radius` views of the middle of the grid; those on its edge count in part.

    Raises `InvalidOption` where it lets no view through.
    """
    v, u = (np.arange(count) - (count - 1) / 2 for count in grid)
    distance = np.hypot(v[:, np.newaxis], u)
    weights: NDArray[np.float32] = np.clip(radius + 0.5 - distance, 0, 1).astype(np.float32)
    if not weights.any():
        raise InvalidOption(f"aperture: a radius of {radius:g} views lets no view through; give 0.5 or more")
    return weights


class Spectra:
    """The Fourier transforms of all views, of which planes are made. Safe to use from several threads."""

    def __init__(self, views: NDArray[Any], along: tuple[NDArray[Any], NDArray[Any]], most: float) -> None:
        """`views`: `(V, U, H, W, C)`. `along`: the place of each row `(V,)` and column `(U,)` of views, counted from
        the view that planes line up with. `most`: the largest disparity, without its sign, that planes will have.
        """
        self._views, self._along, self._workers = views, along, _count_cores()
        self._padded = [
            fft.next_fast_len(length + int(np.ceil(most * np.abs(places).max())) + 4, real=True)
            for length, places in zip(views.shape[2:4], along, strict=True)
        ]
        self._half = self._padded[1] // 2 + 1
        size = 8 * views.shape[0] * views.shape[1] * views.shape[4] * self._padded[0] * self._half
        self._kept = [self._transform(row) for row in views] if size <= KEPT else None

    def add_planes(self, disparities: Numbers, weights: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
        """The mean of all views with their `weights` at each of `disparities`, `(C, H, W)`."""
        batch = max(1, MEMORY // (8 * self._views[0, 0].size))
        for start in range(0, len(disparities), batch):
            some = np.asarray(disparities[start : start + batch], np.float64)[:, np.newaxis]
            rows, cols = (
                _Shifts(some * places, length, padded)
                for places, length, padded in zip(self._along, self._views.shape[2:4], self._padded, strict=True)
            )
            reached = np.einsum("pvy,vu,pux->pyx", rows.reach, weights, cols.reach, optimize=True)
            for plane, reach in zip(self._add(rows, cols, weights), reached, strict=True):
                is_reached = reach > _LEAST * weights.sum()
                yield np.where(is_reached, plane / np.where(is_reached, reach, 1), 0)

    def _transform(self, row: NDArray[Any]) -> NDArray[np.complex64]:
        """The transforms of a row of views, `(half, C, U, padded)`: frequencies along x come first."""
        pictures = row.transpose(3, 0, 1, 2).astype(np.float32)  # (C, U, H, W)
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
    """Shifts of signals of `length` samples by `(planes, views)` pixels towards larger indices."""

    def __init__(self, shifts: NDArray[np.float64], length: int, padded: int) -> None:
        self.length = length
        whole = np.floor(shifts)
        taps = _make_taps(shifts - whole)  # (planes, views, 4), for offsets -1 to 2
        turns = np.exp(-2j * np.pi * (whole[..., np.newaxis] + np.arange(-1, 3))[..., np.newaxis] * fft.fftfreq(padded))
        self.factors = np.einsum("pkt,pktf->pkf", taps, turns).astype(np.complex64)
        """`(planes, views, frequencies)`."""
        inside = fft.fft(np.ones(length, np.float32), padded)
        self.reach = fft.ifft(self.factors * inside).real[..., :length].astype(np.float32)
        """`(planes, views, length)`: the share of the kernel that lies inside the view."""


def _make_taps(fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of Keys's kernel (IEEE ASSP 29, 1981, equation 15) for a shift by `fraction`, 0 to 1, of a pixel."""
    distance = np.abs(fraction[..., np.newaxis] - np.arange(-1, 3))
    near = (1.5 * distance - 2.5) * distance**2 + 1
    far = ((-0.5 * distance + 2.5) * distance - 4) * distance + 2
    return np.where(distance <= 1, near, np.where(distance < 2, far, 0))


def _count_cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
