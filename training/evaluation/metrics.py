"""PSNR and SSIM by the published protocol for super-resolution, computed by scikit-image; and scores of disparity maps.

PSNR and SSIM compare `(H, W)` arrays of levels from 0 to 255, usually luma, after a border is cut. scikit-image is slow
to import, so it is imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ciir.models.cards import Accuracy

if TYPE_CHECKING:
    from collections.abc import Mapping

Pixels = NDArray[np.uint8]
Plane = NDArray[np.float64]

PEAK = 255
SSIM_RADIUS = 5
"""Radius of SSIM's window of 11x11 pixels."""

BAD = 0.07
"""The least error of a bad pixel's disparity, in pixels per view."""

Value = TypeVar("Value", bound=np.generic)


class MapScore(NamedTuple):
    """Scores of a disparity map."""

    pixels: int
    """Finite pixels of the truth."""
    bad: float
    """BadPix(0.07), a share. A pixel that is not finite in the map is bad."""
    mse: float
    """100 times the mean square error over the pixels that are finite in both; NaN if there are none."""
    not_finite: int
    """Pixels of the map that are not finite, but are in the truth."""
    without_truth: int
    """Pixels that don't count: they are not finite in the truth, or have no confidence there."""


def rgb_to_luma(picture: Pixels) -> Plane:
    """Computes Y of ITU-R BT.601, studio range, as MATLAB's `rgb2ycbcr`: `(H, W, 3)` 8-bit RGB -> `(H, W)` in
    [16, 235].
    """
    weights = np.array([65.481, 128.553, 24.966]) / 255.0
    return np.asarray(16.0 + picture.astype(np.float64) @ weights)


def convert_to_luma(picture: Pixels) -> Plane:
    """Computes Y of `(H, W, 3)` RGB as the published scripts do. Grey, `(H, W, 1)`, is its own Y with its full range:
    the studio range would add 1.3 dB.
    """
    return rgb_to_luma(picture) if picture.shape[2] == 3 else picture[..., 0].astype(np.float64)


def compute_psnr(picture: Plane, truth: Plane, *, border: int) -> float:
    """Computes the peak signal-to-noise ratio in dB inside a border of `border` pixels; inf if both are equal.

    Raises `ValueError` if the sizes differ.
    """
    from skimage.metrics import peak_signal_noise_ratio

    with np.errstate(divide="ignore"):
        return float(peak_signal_noise_ratio(_crop(truth, border), _crop(picture, border), data_range=PEAK))


def compute_ssim(picture: Plane, truth: Plane, *, border: int) -> float:
    """Computes the mean structural similarity, at most 1, inside a border of `border` pixels.

    Wang et al., IEEE Trans. Image Processing 13(4), 2004, equation 13, as their MATLAB `ssim_index` computes it: an
    11x11 Gaussian window of sigma 1.5 that stays inside the picture, K = (0.01, 0.03).

    Raises `ValueError` if the sizes differ or are smaller than a window.
    """
    picture, truth = _crop(picture, border), _crop(truth, border)
    if min(truth.shape) <= 2 * SSIM_RADIUS:
        raise ValueError(f"a picture of {truth.shape} inside its border is smaller than SSIM's window of 11x11")
    return float(np.mean(compute_ssim_map(picture, truth)))


def compute_ssim_map(picture: Plane, truth: Plane) -> Plane:
    """Computes similarity at each place of the window (see `compute_ssim`): two `(H, W)` arrays -> `(H-10, W-10)`."""
    from skimage.metrics import structural_similarity

    _, similarity = structural_similarity(
        picture,
        truth,
        data_range=PEAK,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return np.asarray(_crop(similarity, SSIM_RADIUS))


def score_map(found: NDArray[np.floating[Any]], true: NDArray[np.floating[Any]]) -> MapScore:
    """Scores a disparity map against a true one `(H, W)` that has a finite pixel; both in pixels per view."""
    counted = np.isfinite(true)
    error = np.abs(found[counted] - true[counted])
    known = error[np.isfinite(error)]
    mse = 100 * float(np.mean(np.square(known))) if known.size else float("nan")
    pixels = int(counted.sum())
    return MapScore(pixels, float(np.mean(~(error <= BAD))), mse, pixels - known.size, true.size - pixels)


def average(name: str, scores: Mapping[Any, tuple[float, float]]) -> Accuracy:
    """Returns the means of the PSNR and SSIM of several pictures or views, as those of `name`.

    Identical ones, whose PSNR is infinite, are left out of its mean, unless all are identical.
    """
    psnr, ssim = np.transpose(list(scores.values()))
    finite = psnr[np.isfinite(psnr)]
    mean = finite.mean() if finite.size else np.inf
    return Accuracy(name, len(scores), round(float(mean), 4), round(float(ssim.mean()), 5))


def _crop(plane: NDArray[Value], border: int) -> NDArray[Value]:
    height, width = plane.shape
    return plane[border : height - border, border : width - border]
