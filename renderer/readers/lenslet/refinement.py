"""Refines a grid to its last digits, by least squares over the lenses that look like most others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.renderer.readers.lenslet.signals import FLOOR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.lenslet.grid import LensGrid

MOST_POINTS = 4_000_000
"""The most samples of all lenses together. If there are more, only every nth lens is used."""
_REACH = 0.7  # pitches from a lens's centre to the side of its window, which holds the borders on both sides
_ROUNDS = 6
_BLOCKS = 4  # along each side of the picture
_LIKENESS = 0.9  # the least that counts, as a share of that of the best tenth


@dataclass(frozen=True)
class Lenses:
    """Lenses of a grid that are lit and lie in the picture with their borders, each `(n,)`. If there are very many,
    only some.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    share: float
    """The share of lit lenses among all that lie in the picture."""

    @classmethod
    def find(cls, grid: LensGrid, blurred: NDArray[np.float32]) -> Lenses:
        """Finds those of `grid` in a picture whose scene has the brightness `blurred`, `(H, W)`."""
        size = np.array(blurred.shape)
        reach = int(1.3 * np.hypot(*size) / grid.pitch) + 2
        first = grid.find_nearest((size - 1) / 2)
        i, j = (
            side.ravel() + at for side, at in zip(np.mgrid[-reach : reach + 1, -reach : reach + 1], first, strict=True)
        )
        centers = grid.find_centers(i, j)
        inside = np.flatnonzero(((centers > grid.pitch) & (centers < size - 1 - grid.pitch)).all(axis=1))
        inside = inside[:: 1 + len(inside) * len(_make_window(grid.pitch)) // MOST_POINTS]
        lit = inside[_sample(blurred, centers[inside]) > 2 * FLOOR]
        return cls(i[lit], j[lit], len(lit) / max(len(inside), 1))


@dataclass(frozen=True)
class Refinement:
    """A grid, and how well the lenses agree with it."""

    grid: LensGrid
    share: float
    """The share of the lenses in the picture that counted."""
    scatter: float
    """Median distance of these lenses' own positions from the grid's, in pixels."""
    uncertainty: float
    """Standard error of the pitch, in pixels, times the lenses along the picture's longer side."""


def refine_grid(
    signal: NDArray[np.float32],
    blurred: NDArray[np.float32],
    lenses: Lenses,
    grid: LensGrid,
    *,
    keep_pitch: bool,
    keep_offset: bool,
    keep_rotation: bool,
) -> Refinement:
    """Finds the grid that fits `signal` best; `grid` may be wrong by a fifth of a pitch.

    `signal`: `(H, W)`, bright inside lenses (`signals.show_lenses`). `blurred`: `(H, W)`, the scene's brightness. Each
    round takes the mean of the lenses as the template and finds how far each lens is displaced from it. The template is
    made symmetric about its centre, which settles the offset. Content moves the borders of its lenses a little towards
    its darker side, by an amount that depends on its depth. The gradient of the brightness times a quadratic function
    of the position accounts for that.
    """
    window = _make_window(_REACH * grid.pitch)
    i, j = lenses.i, lenses.j
    centers = grid.find_centers(i, j)
    evenness = _sample(_measure_evenness(blurred, grid.pitch), centers)
    slopes = np.stack(
        [
            _sample(ndimage.gaussian_filter1d(np.log(blurred + FLOOR), grid.pitch / 3, axis=axis, order=1), centers)
            for axis in (0, 1)
        ],
        axis=-1,
    )
    around = (centers - centers.mean(axis=0)) / (centers.std(axis=0) + 1e-9)
    y, x = around.T
    depth = np.stack([np.ones(len(i)), y, x, y * y, y * x, x * x], axis=1)
    some = window[:: max(1, len(window) // 64)]
    limit = np.percentile(np.abs(_sample(signal, centers[:, None] + some)), 97)
    counts = evenness >= np.percentile(evenness, 60)
    free = ~np.array([False, False, keep_pitch, keep_rotation, *[False] * depth.shape[1]])
    scatter = uncertainty = 0.0
    for _ in range(_ROUNDS):
        centers, axes, pitch = grid.find_centers(i, j), grid.axes, grid.pitch
        windows = np.clip(_sample(signal, centers[:, None] + window @ axes), -limit, limit)
        template = windows[counts].mean(axis=0)
        if not keep_offset:
            template = (template + template[::-1]) / 2
        places, likeness = _compare(windows, template)
        counts = likeness > _LIKENESS * np.percentile(likeness, 90)
        if not counts.any():
            return Refinement(grid, 0.0, np.inf, np.inf)
        # Rows of the equations: displacement across and along the rows, by offset (2), scale, turn and gradient (6).
        lattice = (centers - np.asarray(grid.offset)) @ axes.T
        equations = np.zeros((len(i), 2, len(free)))
        equations[:, 0, 0] = equations[:, 1, 1] = 1
        equations[:, :, 2] = lattice
        equations[:, 0, 3], equations[:, 1, 3] = lattice[:, 1], -lattice[:, 0]
        equations[:, :, 4:] = pitch * (slopes @ axes.T)[:, :, None] * depth[:, None]
        found, settled = (
            np.zeros(len(free)),
            (equations[counts][:, :, free], np.clip(places[counts], -pitch / 4, pitch / 4)),
        )
        found[free], scatter = _solve(*settled)
        offset = np.asarray(grid.offset) + (np.zeros(2) if keep_offset else found[:2] @ axes)
        grid = replace(
            grid,
            offset=(float(offset[0]), float(offset[1])),
            pitch=float(pitch * (1 + found[2])),
            rotation=float(grid.rotation + np.rad2deg(found[3])),
        )
    if not keep_pitch:
        uncertainty = max(signal.shape) * _measure_error(*settled, around[counts])
    return Refinement(grid, float(counts.mean()) * lenses.share, scatter, uncertainty)


def center_grid(signal: NDArray[np.float32], lenses: Lenses, grid: LensGrid) -> LensGrid:
    """Returns `grid` with its offset moved by up to a quarter of a pitch, to where the mean lens is most nearly
    symmetric.
    """
    step = max(1, round(grid.pitch / 24))
    count = round(grid.pitch / 4) // step  # steps to each side
    margin = count * step
    window = _make_window(_REACH * grid.pitch + margin)
    side = round(len(window) ** 0.5)
    centers = grid.find_centers(lenses.i, lenses.j)
    mean = _sample(signal, centers[:, None] + window @ grid.axes).mean(axis=0).reshape(side, side)
    likeness = np.zeros((2 * count + 1, 2 * count + 1))
    for shift in np.ndindex(likeness.shape):
        top, left = (step * number for number in shift)
        part = mean[top : top + side - 2 * margin, left : left + side - 2 * margin].ravel()
        part = part - part.mean()
        likeness[shift] = part @ part[::-1] / (part @ part + 1e-12)
    best = np.array(np.unravel_index(likeness[1:-1, 1:-1].argmax(), (2 * count - 1, 2 * count - 1))) + 1
    between = np.zeros(2)
    for axis, along in enumerate(np.eye(2, dtype=int)):
        before, at, after = (likeness[tuple(best + way * along)] for way in (-1, 0, 1))
        if before + after < 2 * at:
            between[axis] = np.clip(0.5 * (before - after) / (before - 2 * at + after), -0.5, 0.5)
    moved = np.asarray(grid.offset) + step * (best + between - count) @ grid.axes
    return replace(grid, offset=(float(moved[0]), float(moved[1])))


def measure_depth(luma: NDArray[np.float32], lenses: Lenses, grid: LensGrid) -> float:
    """Measures how much darker lenses are at their left and right borders than in their middle.

    Returns the median over lit lenses of the difference of logarithms.
    """
    logs = np.log(ndimage.gaussian_filter(luma, max(1.0, grid.pitch / 12)) + np.float32(FLOOR))
    i, j = lenses.i, lenses.j
    center, left, right = (_sample(logs, grid.find_positions(i, j + grid.find_shift(i) + d)) for d in (0.0, -0.5, 0.5))
    return float(np.median(center - (left + right) / 2))


def _make_window(reach: float) -> NDArray[np.float64]:
    """Returns (y, x) of samples one pixel apart, up to `reach` pixels on each side of a lens's centre, `(n, 2)`."""
    side = np.arange(-np.floor(reach), np.floor(reach) + 1)
    window: NDArray[np.float64] = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    return window


def _measure_evenness(blurred: NDArray[np.float32], pitch: float) -> NDArray[np.float32]:
    """Returns the least brightness within half a pitch divided by the greatest, `(H, W)`."""
    side = 2 * round(pitch / 2) + 1
    even: NDArray[np.float32] = ndimage.minimum_filter(blurred, side) / (ndimage.maximum_filter(blurred, side) + 1)
    return even


def _sample(picture: NDArray[np.float32], points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Returns bilinear samples at (y, x), `(..., 2)`."""
    samples: NDArray[np.float32] = ndimage.map_coordinates(picture, np.moveaxis(points, -1, 0), order=1, mode="nearest")
    return samples


def _compare(
    windows: NDArray[np.float32], template: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns how far each window's lens is displaced from the template, (y, x) `(n, 2)`, and their correlation `(n,)`.

    `windows`: `(n, samples)`. The equations are those of Lucas and Kanade (1981), with a factor and a constant.
    """
    side = round(len(template) ** 0.5)
    template = template - template.mean()
    slope_y, slope_x = (slope.ravel() for slope in np.gradient(template.reshape(side, side)))
    basis = np.stack([np.ones_like(template), template, -slope_y, -slope_x], axis=1)
    parts = np.linalg.lstsq(basis, windows.T, rcond=None)[0]  # (4, n)
    centred = windows - windows.mean(axis=1, keepdims=True)
    norm = np.sqrt((template**2).sum() * (centred**2).sum(axis=1)) + 1e-12
    return (parts[2:] / np.maximum(parts[1], 0.2)).T, centred @ template / norm


def _solve(equations: NDArray[np.float64], places: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Solves `equations`, `(n, 2, unknowns)`, by least squares with Tukey's weights; also returns the median distance
    from `places`.
    """
    count = equations.shape[2]
    found, middle = np.zeros(count), 0.0
    flat = equations.reshape(-1, count)
    for _ in range(10):
        distance = np.hypot(*(places - (flat @ found).reshape(-1, 2)).T)
        middle = float(np.median(distance))
        weight = np.clip(1 - (distance / (4 * max(middle, 0.01))) ** 2, 0, 1) ** 2
        left = flat.T * weight.repeat(2)
        # The normal equations: few unknowns of similar size, and 20 times as fast as the tall matrix itself.
        found = np.linalg.lstsq(left @ flat, left @ places.ravel(), rcond=None)[0]
    return found, middle


def _measure_error(equations: NDArray[np.float64], places: NDArray[np.float64], around: NDArray[np.float64]) -> float:
    """Returns the standard error of the third unknown, by the jackknife over blocks of the picture, because neighbours
    err alike.
    """
    bands = [np.digitize(side, np.quantile(side, np.arange(1, _BLOCKS) / _BLOCKS)) for side in around.T]
    block = _BLOCKS * bands[0] + bands[1]
    found = [_solve(equations[block != left], places[block != left])[0][2] for left in np.unique(block)]
    return float(np.sqrt((len(found) - 1) * np.var(found)))
