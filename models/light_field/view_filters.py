"""Filters that combine the samples of all views of a window into a finer picture, with the least squared error.

For disparity `d`, sample `n` of a view at offset `a` shows the scene at `n - d*a` of the view to be upscaled. The scene
is modelled as a random process whose correlation falls off exponentially, and each sample as its mean over the
footprint of a sensor element. A pixel of twice the resolution is then estimated from the samples near it by a Wiener
filter (as in kriging, or Hardie, IEEE TIP 16(12), 2007, for shifted frames). Unlike adding up the nearest samples, this
undoes the blur of the footprint and of the samples' distances. It gains 1.7 and 2.1 dB on two captured light fields.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models.single.interpolation import keys_kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

CORRELATION = 5.0
"""Distance in LR pixels over which the scene's correlation falls to 1/e."""
NOISE = 0.01
"""Variance of a sample's noise divided by that of the scene."""
STEPS = 16
"""Samples per LR pixel of footprints and correlations."""
DISPARITIES = 5
"""Number of disparities within a plane over which the filter is optimised on average."""


def make_filters(
    disparities: Array,
    widths: Array,
    offsets: NDArray[np.integer],
    taps: NDArray[np.integer],
    *,
    reach: float,
    phase: float,
) -> Array:
    """Makes the filters of one axis, `(planes, 2, offsets, taps)`, for fine samples at `-phase` and `+phase` LR pixels.

    `disparities`: those of the planes, LR pixels per view. Each stands for the disparities up to half its entry of
    `widths` away. `offsets`: those of the views that are present. `taps`: LR pixels relative to the pixel. Samples
    further away than `reach` LR pixels are not used. Each filter sums to 1.
    """
    lags, among, to_fine = _correlate()
    filters = np.zeros((len(disparities), 2, len(offsets), len(taps)))
    step = np.repeat(offsets, len(taps)).astype(float)
    for plane, disparity in enumerate(disparities):
        place = (taps[None, :] - disparity * offsets[:, None]).ravel()
        used = np.flatnonzero(np.abs(place) <= reach)
        covariance, targets = NOISE * np.eye(len(used)), np.zeros((2, len(used)))
        for error in np.linspace(-widths[plane] / 2, widths[plane] / 2, DISPARITIES):
            there = place[used] - error * step[used]
            covariance += np.interp(there[:, None] - there, lags, among) / DISPARITIES
            targets += [np.interp(there - at, lags, to_fine) / DISPARITIES for at in (-phase, phase)]
        solved = np.linalg.solve(covariance, np.column_stack([*targets, np.ones(len(used))]))
        even = solved[:, 2] / solved[:, 2].sum()
        for side in range(2):
            weights = solved[:, side] + even * (1 - solved[:, side].sum())
            filters[plane, side].reshape(-1)[used] = weights
    return filters


def _correlate() -> tuple[Array, Array, Array]:
    """Returns lags in LR pixels, and for each lag the correlation of two samples, and of a sample and a fine pixel.

    These are means over the footprints of a bicubic, a box and a point sample, because it is unknown which of them made
    a picture.
    """
    place = (np.arange(-4 * STEPS, 4 * STEPS) + 0.5) / STEPS
    distance = np.abs(place)
    footprints = [keys_kernel(place), (distance < 0.5) * 1.0, (distance < 0.125) * 1.0]
    fine = (distance < 0.25) / (distance < 0.25).sum()
    lags = np.arange(-16 * STEPS, 16 * STEPS + 1) / STEPS
    scene = np.exp(-np.abs(lags) / CORRELATION)
    among, to_fine = np.zeros(len(lags)), np.zeros(len(lags))
    for footprint in (of / of.sum() for of in footprints):
        among += np.convolve(scene, np.convolve(footprint, footprint[::-1]), "same") / len(footprints)
        to_fine += np.convolve(scene, np.convolve(footprint, fine[::-1]), "same") / len(footprints)
    return lags, among, to_fine
