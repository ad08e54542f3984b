"""Colours for maps of numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_VIRIDIS = (
    (0.2777273272234177, 0.005407344544966578, 0.3340998053353061),
    (0.1050930431085774, 1.404613529898575, 1.384590162594685),
    (-0.3308618287255563, 0.214847559468213, 0.09509516302823659),
    (-4.634230498983486, -5.799100973351585, -19.33244095627987),
    (6.228269936347081, 14.17993336680509, 56.69055260068105),
    (4.776384997670288, -13.74514537774601, -65.35303263337234),
    (-5.435455855934631, 4.645852612178535, 26.3124352495832),
)
"""RGB coefficients of the powers of the share, from 0: a fit to matplotlib's map by Matt Zucker
(shadertoy.com/view/WlfXRN, public domain)."""


def color_map(values: NDArray[np.floating], low: float, high: float) -> NDArray[np.uint8]:
    """Returns `values` `(H, W)` as RGB `(H, W, 3)`, from dark blue at `low` to yellow at `high`.

    The colour map is viridis (Smith and van der Walt 2015), whose steps look equal, also without colour vision and in
    grey.
    """
    levels = np.polynomial.polynomial.polyval(np.linspace(0, 1, 256), np.array(_VIRIDIS))  # (3, 256)
    table = (255 * levels.T.clip(0, 1)).round().astype(np.uint8)
    share = (values - low) / max(high - low, 1e-12)
    colored: NDArray[np.uint8] = table[(255 * share.clip(0, 1)).round().astype(np.uint8)]
    return colored
