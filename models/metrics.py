"""Accuracy by the field's published protocol."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
Plane = NDArray[np.float64]

SSIM_RADIUS = 5
"""Of the window, 11x11."""
SSIM_SIGMA = 1.5


def luma(picture: Pixels) -> Plane:
    """Y of ITU-R BT.601, studio range, as MATLAB's `rgb2ycbcr`: `(H, W, 3)` 8-bit RGB -> `(H, W)` in [16, 235]."""
    weights = np.array([65.481, 128.553, 24.966]) / 255.0
    return np.asarray(16.0 + picture.astype(np.float64) @ weights)


def psnr(picture: Plane, truth: Plane, *, border: int, peak: float = 255.0) -> float:
    """Peak signal-to-noise ratio in dB of `(H, W)` arrays after a border of `border` pixels is cut; inf where equal.

    Raises `ValueError` where the sizes differ.
    """
    picture, truth = _inside(picture, truth, border)
    error = float(np.mean((picture - truth) ** 2))
    return float("inf") if error == 0 else float(10.0 * np.log10(peak**2 / error))


def ssim(picture: Plane, truth: Plane, *, border: int, peak: float = 255.0) -> float:
    """Mean structural similarity, at most 1, of `(H, W)` arrays after a border of `border` pixels is cut.

    Wang et al., IEEE Trans. Image Processing 13(4), 2004, equation 13, as their MATLAB `ssim_index` computes it: an
    11x11 Gaussian window of sigma 1.5 that stays inside the picture, K = (0.01, 0.03).

    Raises `ValueError` where the sizes differ or less than one window is left.
    """
    x, y = _inside(picture, truth, border)
    if min(x.shape) <= 2 * SSIM_RADIUS:
        raise ValueError(f"a picture of {x.shape} inside its border is smaller than SSIM's window of 11x11")
    return float(np.mean(ssim_map(x, y, peak=peak)))


def ssim_map(x: Plane, y: Plane, *, peak: float = 255.0) -> Plane:
    """The similarity at each place of the window (see `ssim`): two `(H, W)` arrays -> `(H-10, W-10)`."""
    mean_x, mean_y = _window_mean(x), _window_mean(y)
    variance_x = _window_mean(x * x) - mean_x**2
    variance_y = _window_mean(y * y) - mean_y**2
    covariance = _window_mean(x * y) - mean_x * mean_y
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    above = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    below = (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
    return np.asarray(above / below)


def _inside(picture: Plane, truth: Plane, border: int) -> tuple[Plane, Plane]:
    if picture.shape != truth.shape:
        raise ValueError(f"a picture of {picture.shape} can't be compared with a truth of {truth.shape}")
    height, width = picture.shape
    inside = np.s_[border : height - border, border : width - border]
    return picture[inside], truth[inside]


def _window_mean(plane: Plane) -> Plane:
    """Gaussian-weighted means, `(H, W)` -> `(H-10, W-10)`."""
    distance = np.arange(-SSIM_RADIUS, SSIM_RADIUS + 1)
    weights = np.exp(-(distance**2) / (2 * SSIM_SIGMA**2))
    weights /= weights.sum()
    for axis in (0, 1):
        plane = np.lib.stride_tricks.sliding_window_view(plane, len(weights), axis=axis) @ weights
    return plane
