"""How far pictures are from the truth, on all pixels and on the object alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.training.evaluation.metrics import SSIM_RADIUS, Plane, compute_ssim_map, rgb_to_luma

if TYPE_CHECKING:
    from numpy.typing import NDArray

WORST = 0.01
"""The share of pixels that `gradient_worst` is the mean of."""


@dataclass(frozen=True)
class Error:
    """Of Y (ITU-R BT.601, 8-bit levels), over all pixels of all pictures together. No border is cut."""

    rmse: float
    """Root of the mean square difference, levels."""
    psnr: float
    """dB; inf where equal."""
    ssim: float
    """Mean of the similarity map, at most 1 (Wang et al. 2004); NaN where no window of 11x11 lies within the pixels."""
    gradient: float
    """Mean length of the difference of gradients (forward differences), levels a pixel: blur, ringing and stair steps
    at edges show here."""
    gradient_worst: float
    """The same over the worst 1 % of pixels."""


def compare(pictures: NDArray[np.uint8], truth: NDArray[np.uint8], object_: NDArray[np.bool_] | None = None) -> Error:
    """`pictures` and `truth`: `(n, H, W, 3)` 8-bit RGB. `object_`: `(n, H, W)`, the pixels that count; None: all.

    Raises `ValueError` where the shapes differ or no pixel counts.
    """
    if pictures.shape != truth.shape:
        raise ValueError(f"pictures of {pictures.shape} can't be compared with a truth of {truth.shape}")
    counted = np.ones(truth.shape[:3], bool) if object_ is None else object_
    if not counted.any():
        raise ValueError("no pixel counts: nothing of the object shows in these views")
    square: list[Plane] = []
    similar: list[Plane] = []
    slope: list[Plane] = []
    for picture, true, mask in zip(pictures, truth, counted, strict=True):
        made, wanted = rgb_to_luma(picture), rgb_to_luma(true)
        square.append(((made - wanted) ** 2)[mask])
        slope.append(_gradient(made - wanted)[mask[:-1, :-1]])
        if min(made.shape) > 2 * SSIM_RADIUS:
            inside = mask[SSIM_RADIUS:-SSIM_RADIUS, SSIM_RADIUS:-SSIM_RADIUS]
            similar.append(compute_ssim_map(made, wanted)[inside])
    mse = float(np.mean(np.concatenate(square)))
    slopes, windows = np.sort(np.concatenate(slope)), np.concatenate([*similar, np.empty(0)])
    worst = slopes[-max(1, round(WORST * len(slopes))) :]
    return Error(
        rmse=mse**0.5,
        psnr=float("inf") if mse == 0 else float(10 * np.log10(255.0**2 / mse)),
        ssim=float(windows.mean()) if len(windows) else float("nan"),
        gradient=float(slopes.mean()),
        gradient_worst=float(worst.mean()),
    )


def _gradient(plane: Plane) -> Plane:
    """Length of the forward differences, `(H, W)` -> `(H-1, W-1)`."""
    return np.asarray(np.hypot(np.diff(plane, axis=0)[:, :-1], np.diff(plane, axis=1)[:-1]))
