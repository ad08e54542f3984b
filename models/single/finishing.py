"""Finishes a picture after a single-picture network: the mean with bicubic interpolation, where the network can harm.

Networks sharpen noise, the errors of a JPEG, and the jagged edges of a picture whose pixels are points. What they make
of such a picture doesn't fit it: downscaled again, it differs from its input.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_unused_camera_bits, limit_levels
from ciir.models.sampling import measure_misfit
from ciir.models.single.interpolation import Bicubic
from ciir.models.single.pixels import upscale_pixels

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

FITS, DIFFERS = 0.018, 0.09
"""Up to the first misfit (`models.sampling.measure_misfit`) the network's picture stays as it is, from the second on
interpolation has its largest share. After bicubic downscaling clean photographs have up to 0.013, except 0.017 once;
after means 0.006 to 0.033, and 0.067 once. JPEGs of quality 75 have 0.04 to 0.07, noise of ten levels 0.04 to 0.12,
points 0.02 to 0.12. docs/experiments.md says how these limits were chosen."""
MOST = 0.7
"""The largest share of interpolation."""
STRIP_ROWS = 64
"""Rows of the input that are averaged at once, so that memory doesn't grow with the picture."""


def average_misfit(large: NDArray[Any], small: NDArray[Any]) -> float:
    """Averages `large` `(scale*H, scale*W, C)`, which a network made of `small` `(H, W, C)`, in place with the bicubic
    interpolation of `small`, if it doesn't fit.

    Both have the same type, of 8 or 16 bits, and may have alpha. Returns the share of interpolation, 0 to `MOST`.
    """
    share = MOST * float(np.clip((measure_misfit(large, small) - FITS) / (DIFFERS - FITS), 0, 1))
    if not share:
        return 0.0
    scale = len(large) // len(small)
    bicubic = Bicubic(scale)
    levels = 257 if small.dtype == np.uint8 else 1  # of 16 bits for each level
    for top in range(0, len(small), STRIP_ROWS):
        first, bottom = max(top - bicubic.radius, 0), min(top + STRIP_ROWS, len(small))
        smooth = upscale_pixels(bicubic, small[np.newaxis, first : bottom + bicubic.radius], keeps_fractions=True)[0]
        part = large[scale * top : scale * bottom]
        mixed = np.float32(1 - share) * part
        mixed += np.float32(share / levels) * smooth[scale * (top - first) :][: len(part)]
        mixed += np.float32(0.5)
        part[...] = mixed
    limit_levels(large, count_unused_camera_bits(small))
    return share
