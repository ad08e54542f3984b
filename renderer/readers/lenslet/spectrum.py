"""Makes a first estimate of a lens grid from the spots that its period produces in the Fourier transform."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft, ndimage

from ciir.renderer.readers.lenslet.grid import LEAST_PITCH, MOST_PITCH, Shape, make_axes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

MOST_SIDE = 2048
"""The most pixels along a side of the part in the middle of a picture that is transformed."""
LEAST_LENSES = 8
"""The least lenses along each side of the part that is transformed: with fewer, the spots don't stand apart."""
_PEAKS = 400  # the scene's texture makes peaks too
_BACKGROUND = 31  # bins: a texture's spectrum is smooth over them, a spot is 3 bins wide
_CEILING = 8.0  # the most that one spot counts, because a grid has all of them
_FLOOR = 1e-5  # of the highest power: rounding in clean pictures, which has the period of pitch and pixels, is below
_NOISE, _SAME = 2.0, 0.75  # contrast without a grid; share of a grid's own contrast that others may have
_H = 2 / 3**0.5
SPOTS: dict[Shape, NDArray[np.float64]] = {
    "square": np.array([(0, 1), (1, 0), (1, 1), (1, -1), (2, 0), (0, 2)], np.float64),
    "hexagonal": np.array(
        [(_H / 2, 1), (-_H / 2, 1), (_H, 0), (0, 2), (1.5 * _H, 1), (-1.5 * _H, 1), (2 * _H, 0), (_H, 2), (-_H, 2)]
    ),
}
"""Frequencies across and along the rows, in cycles per pitch, of the strongest spots of each shape."""
FIRST = {"square": 2, "hexagonal": 3}
"""How many of `SPOTS` are the first ring."""
SYMMETRY = {"square": 90.0, "hexagonal": 60.0}
"""Degrees of rotation after which a grid looks the same."""


@dataclass(frozen=True, order=True)
class Estimate:
    """A grid's pitch and rotation, without its offset."""

    contrast: float
    """Mean over the spots of the log of their power relative to that around them."""
    pitch: float
    rotation: float
    shape: Shape


def estimate_grids(
    signal: NDArray[np.float32], shapes: tuple[Shape, ...], *, pitch: float | None, rotation: float | None
) -> dict[Shape, Estimate]:
    """Finds the grid of each shape with the highest contrast in `signal`, `(H, W)`; a given pitch or rotation is kept.

    A shape is left out if no peak of the spectrum can be its own.
    """
    height, width = (min(side, MOST_SIDE) for side in signal.shape)
    top, left = (signal.shape[0] - height) // 2, (signal.shape[1] - width) // 2
    part = signal[top : top + height, left : left + width]
    window = np.hanning(height)[:, None] * np.hanning(width)[None]
    spectrum = fft.fftshift(fft.fft2(((part - part.mean()) * window).astype(np.float32), workers=1))
    logs = np.log(np.abs(spectrum) ** 2 + _FLOOR * np.abs(spectrum).max() ** 2 + 1e-30)
    contrast = logs - ndimage.uniform_filter(logs, _BACKGROUND, mode="nearest")
    near = ndimage.maximum_filter(contrast, 3)
    longest = min(MOST_PITCH, min(height, width) / LEAST_LENSES)
    found: dict[Shape, Estimate] = {}
    for frequency in _find_peaks(contrast):
        for of_pitch, turned, shape in _interpret(frequency, shapes):
            size = of_pitch if pitch is None else pitch
            angle = turned if rotation is None else rotation
            is_given = abs(of_pitch / size - 1) < 0.05 and abs(turned - angle) < 3  # a spot of the given grid
            if not is_given or not LEAST_PITCH <= size <= longest:
                continue
            estimate = Estimate(_measure_contrast(near, size, angle, shape), size, angle, shape)
            found[shape] = max(found.get(shape, estimate), estimate)
    if pitch is None:
        found = {shape: _rule_out_harmonics(near, estimate, longest) for shape, estimate in found.items()}
    return found


def _find_peaks(contrast: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns frequencies (y, x) of the highest local maxima, in cycles per pixel, `(n, 2)`, interpolated by parabolas
    between bins.
    """
    inner = contrast[1:-1, 1:-1]
    is_peak = inner == ndimage.maximum_filter(contrast, 5)[1:-1, 1:-1]
    is_peak[:, : inner.shape[1] // 2 - 1] = False  # the other half mirrors this one
    y, x = np.nonzero(is_peak)
    highest = np.argsort(-inner[y, x], kind="stable")[:_PEAKS]
    y, x = y[highest] + 1, x[highest] + 1
    between = []
    for before, after in ((contrast[y - 1, x], contrast[y + 1, x]), (contrast[y, x - 1], contrast[y, x + 1])):
        bend = before - 2 * contrast[y, x] + after
        between.append(np.where(bend < 0, 0.5 * (before - after) / np.minimum(bend, -1e-6), 0.0))
    bins = np.stack([y, x], axis=1) + np.stack(between, axis=1) - np.array(contrast.shape) // 2
    is_wave = np.abs(bins).max(axis=1) > 1  # not the mean
    frequencies: NDArray[np.float64] = bins[is_wave] / np.array(contrast.shape)
    return frequencies


def _interpret(frequency: NDArray[np.float64], shapes: tuple[Shape, ...]) -> Iterator[tuple[float, float, Shape]]:
    """Yields the pitch, the rotation and the shape of the grids that have `frequency` in their first ring of spots."""
    for shape in shapes:
        spot, period = SPOTS[shape][0], SYMMETRY[shape]
        angle = np.rad2deg(np.arctan2(*frequency) - np.arctan2(*spot))
        turned = (angle + period / 2) % period - period / 2
        yield float(np.hypot(*spot) / np.hypot(*frequency)), float(turned), shape


def _rule_out_harmonics(near: NDArray[np.float32], estimate: Estimate, longest: float) -> Estimate:
    """Returns the estimate with the longest pitch that has nearly the same contrast, trying two and three times the
    pitch repeatedly.

    All spots of half a pitch are also spots of the pitch; for twice the pitch, half of the spots are missing.
    """
    for times in (2, 3):
        pitch = times * estimate.pitch
        contrast = _measure_contrast(near, pitch, estimate.rotation, estimate.shape) if pitch <= longest else -np.inf
        if contrast - _NOISE >= _SAME * (estimate.contrast - _NOISE):
            return _rule_out_harmonics(near, replace(estimate, contrast=contrast, pitch=pitch), longest)
    return estimate


def _measure_contrast(near: NDArray[np.float32], pitch: float, rotation: float, shape: Shape) -> float:
    """Returns the mean contrast of the grid's spots, or the lowest value if a spot of the first ring lies outside the
    spectrum.
    """
    size = np.array(near.shape)
    bins = np.rint(SPOTS[shape] @ make_axes(rotation) / pitch * size).astype(int) + size // 2
    is_inside = ((bins >= 0) & (bins < size)).all(axis=1)
    if not is_inside[: FIRST[shape]].all():
        return -np.inf
    y, x = bins[is_inside].T
    return float(np.clip(near[y, x], -2, _CEILING).mean())
