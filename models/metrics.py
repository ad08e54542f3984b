"""Accuracy by the field's published protocol."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def luma(picture: Pixels) -> NDArray[np.float64]:
    """Y of ITU-R BT.601, studio range, as MATLAB's `rgb2ycbcr`: `(H, W, 3)` 8-bit RGB -> `(H, W)` in [16, 235]."""
    weights = np.array([65.481, 128.553, 24.966]) / 255.0
    return np.asarray(16.0 + picture.astype(np.float64) @ weights)


def psnr(picture: NDArray[np.float64], truth: NDArray[np.float64], *, border: int, peak: float = 255.0) -> float:
    """Peak signal-to-noise ratio in dB of `(H, W)` arrays after a border of `border` pixels is cut; inf where equal.

    Raises `ValueError` where the sizes differ.
    """
    if picture.shape != truth.shape:
        raise ValueError(f"a picture of {picture.shape} can't be compared with a truth of {truth.shape}")
    height, width = picture.shape
    inside = np.s_[border : height - border, border : width - border]
    error = float(np.mean((picture[inside] - truth[inside]) ** 2))
    return float("inf") if error == 0 else float(10.0 * np.log10(peak**2 / error))
