"""Signals that show the lenses of a raw lenslet picture in any scene: dark borders, and edges along borders.

Content drifts through the elemental images with a period of its own, and follows its own outline. So brightness itself
misleads about pitch, but a narrow valley or edge that many lenses have in the same place does not. Logarithms make both
the same in bright and in dark lenses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from numpy.typing import NDArray

Cue = Literal["borders", "edges"]
"""The cue that shows the grid: lenses that darken towards their borders, or content that breaks off there."""

FLOOR = 8.0
"""A level out of `scale_luma`'s 255: darker pixels show their noise instead of their lens."""
_FINE = 1.0  # pixels: standard deviation of the filters


def scale_luma(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float32]:
    """Returns the luma `(H, W)` of `(H, W, C)`, BT.601, scaled so that its brightest thousandth is at 255. Alpha is
    ignored.
    """
    weights = np.array([0.299, 0.587, 0.114] if picture.shape[2] >= 3 else [1.0], np.float32)
    luma = np.tensordot(picture[..., : len(weights)].astype(np.float32), weights, 1)
    brightest = float(np.percentile(luma[:: max(1, luma.shape[0] // 1024)], 99.9))
    scaled: NDArray[np.float32] = luma * np.float32(255 / max(brightest, 1.0))
    return scaled


def show_lenses(luma: NDArray[np.float32], cue: Cue) -> NDArray[np.float32]:
    """Returns a picture `(H, W)` that is brighter inside lenses than at their borders, at the scale of a pixel."""
    if cue == "borders":
        logs = np.log(np.maximum(luma, 0) + np.float32(FLOOR))
        shown: NDArray[np.float32] = -ndimage.gaussian_laplace(logs, _FINE)
    else:
        shown = -ndimage.gaussian_gradient_magnitude(luma, _FINE)
    return shown


def show_periods(luma: NDArray[np.float32], cue: Cue) -> NDArray[np.float32]:
    """Returns a picture `(H, W)` whose spectrum shows the grid most clearly."""
    return luma if cue == "borders" else show_lenses(luma, "edges")


def blur_lenses(luma: NDArray[np.float32], pitch: float) -> NDArray[np.float32]:
    """Returns the brightness of the scene, `(H, W)`, without its lenses."""
    blurred: NDArray[np.float32] = ndimage.gaussian_filter(luma, pitch / 2)
    return blurred


def find_even_parts(blurred: NDArray[np.float32], pitch: float) -> NDArray[np.bool_]:
    """Returns a mask `(H, W)` of where the scene is lit and has no outline within a pitch; see `blur_lenses`."""
    around = ndimage.maximum_filter(blurred, 2 * round(pitch) + 1)
    even: NDArray[np.bool_] = (blurred > 0.85 * around) & (blurred > 2 * FLOOR)
    return even
