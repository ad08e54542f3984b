"""Errors of pictures against the truth: over all pixels, over the object alone, and where they are largest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.training.evaluation.metrics import SSIM_RADIUS, compute_ssim_map, rgb_to_luma

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Error:
    """The error of Y (ITU-R BT.601, 8-bit levels) over all pixels of all pictures together. No border is cut."""

    rmse: float
    """Root of the mean square difference, in levels."""
    psnr: float
    """dB; inf if equal."""
    ssim: float
    """Mean of the similarity map, at most 1 (Wang et al. 2004); NaN for pictures smaller than its 11x11 window."""


def compare(pictures: NDArray[np.uint8], truth: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> Error:
    """Compares `pictures` with `truth`, both `(n, H, W, 3)` 8-bit RGB. `mask`: `(n, H, W)`, the pixels that count;
    None: all.

    Raises `ValueError` if the shapes differ or no pixel counts.
    """
    if pictures.shape != truth.shape:
        raise ValueError(f"pictures of {pictures.shape} can't be compared with a truth of {truth.shape}")
    counted = np.ones(truth.shape[:3], bool) if mask is None else mask
    if not counted.any():
        raise ValueError("no pixel counts: nothing of the object shows in these views")
    lumas = [(rgb_to_luma(picture), rgb_to_luma(true)) for picture, true in zip(pictures, truth, strict=True)]
    mse = float(np.mean(np.stack([(one - other) ** 2 for one, other in lumas])[counted]))
    ssim = float("nan")
    if min(truth.shape[1:3]) > 2 * SSIM_RADIUS:
        inside = counted[:, SSIM_RADIUS:-SSIM_RADIUS, SSIM_RADIUS:-SSIM_RADIUS]
        similar = np.stack([compute_ssim_map(one, other) for one, other in lumas])[inside]
        ssim = float(similar.mean()) if similar.size else ssim
    psnr = float("inf") if mse == 0 else float(10 * np.log10(255.0**2 / mse))
    return Error(rmse=mse**0.5, psnr=psnr, ssim=ssim)


def find_worst_window(
    picture: NDArray[np.uint8], truth: NDArray[np.uint8], other: NDArray[np.uint8], *, side: int
) -> tuple[slice, slice]:
    """Finds the window of at most `side x side` pixels in which `picture` is worst against `other`, all `(H, W, 3)`."""
    errors = [np.square(one.astype(np.int64) - truth).sum(axis=-1) for one in (picture, other)]
    height, width = (min(side, length) for length in truth.shape[:2])
    total = np.pad(errors[0] - errors[1], ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    sums = total[height:, width:] - total[:-height, width:] - total[height:, :-width] + total[:-height, :-width]
    y, x = (int(place) for place in np.unravel_index(int(sums.argmax()), sums.shape))
    return slice(y, y + height), slice(x, x + width)
