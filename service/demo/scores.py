"""PSNR and SSIM of a view with the core packages only: `training.evaluation.metrics` needs others.

Both compare luma (ITU-R BT.601, levels from 16 to 235) inside a border, by the published protocol for x2. A test
compares the values with `training.evaluation.metrics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

BORDER = 2
"""Pixels cut on each side before a picture is compared."""
PEAK = 255
RADIUS, SIGMA = 5, 1.5
"""Radius and sigma of SSIM's Gaussian window, in pixels."""


@dataclass(frozen=True)
class Score:
    """The score of a picture against the truth."""

    psnr: float
    """dB; inf if both are equal."""
    ssim: float
    """At most 1."""

    def __str__(self) -> str:
        return f"{self.psnr:.2f} dB, SSIM {self.ssim:.3f}"


def compare(picture: Pixels, truth: Pixels) -> Score:
    """Scores `picture`, `(H, W, 3)` 8-bit RGB like `truth`, at least 15 pixels along each side."""
    one, other = _luma(picture), _luma(truth)
    with np.errstate(divide="ignore"):
        psnr = float(20 * np.log10(PEAK) - 10 * np.log10(np.mean((one - other) ** 2)))
    return Score(psnr, _compute_ssim(one, other))


def _luma(picture: Pixels) -> NDArray[np.float64]:
    """Returns Y inside the border, `(H-4, W-4)`."""
    inside = picture[BORDER:-BORDER, BORDER:-BORDER].astype(np.float64)
    return np.asarray(16.0 + inside @ np.array([65.481, 128.553, 24.966]) / 255)


def _compute_ssim(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Averages the similarity map (Wang et al. 2004, equation 13) over the windows that stay inside the picture."""
    mean_one, mean_other = _average(one), _average(other)
    variances = _average(one**2) - mean_one**2 + _average(other**2) - mean_other**2
    covariance = _average(one * other) - mean_one * mean_other
    c1, c2 = (0.01 * PEAK) ** 2, (0.03 * PEAK) ** 2
    likeness = (2 * mean_one * mean_other + c1) * (2 * covariance + c2)
    return float(np.mean(likeness / ((mean_one**2 + mean_other**2 + c1) * (variances + c2))))


def _average(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Computes weighted means over the window, `(H, W)` -> `(H-10, W-10)`."""
    return np.asarray(gaussian_filter(plane, SIGMA, radius=RADIUS)[RADIUS:-RADIUS, RADIUS:-RADIUS])
