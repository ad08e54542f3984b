"""Measures the noise of a picture, which makes pixels of different views differ although they see the same point."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from ciir.renderer.levels import drop_alpha

if TYPE_CHECKING:
    from numpy.typing import NDArray

DIFFERENCE = 5.0
"""8-bit levels by which two views of one point may differ without noise."""
_LAPLACIANS = np.outer((1, -2, 1), (1, -2, 1))


def estimate_noise(picture: NDArray[Any]) -> float:
    """Returns the standard deviation of the noise in `picture`, `(H, W, C)`, in its units, without alpha.

    Uses Immerkaer's operator (CVIU 64, 1996) with the lower quartile in place of the mean, so that edges hardly count.
    """
    colours = drop_alpha(picture).astype(np.float32)
    changes = np.abs(ndimage.convolve(colours, _LAPLACIANS[..., np.newaxis], mode="mirror"))
    return float(np.quantile(changes, 0.25)) / (6 * 0.3186)


def measure_blur(deviation: float) -> float:
    """Returns the share of its noise that a picture keeps under a Gaussian of that standard deviation, in pixels."""
    impulse = np.zeros(2 * math.ceil(4 * deviation) + 1)
    impulse[len(impulse) // 2] = 1
    return float(np.square(ndimage.gaussian_filter1d(impulse, deviation)).sum()) if deviation else 1.0
