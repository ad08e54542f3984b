"""Finds views that look as if they were made small with an antialiasing filter, as that of bicubic interpolation.

They have no aliasing, which is what makes other views useful. The mean of a light-field network's picture and one from
the view alone then has the smallest error. A network's picture fits its input: made small again in the same way, it is
close to it. So two ways are compared: the filter, and means of cells, which are what lenslets and sensors see.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.network import compute_luma

if TYPE_CHECKING:
    from PIL import Image

    from ciir.models.light_field.disparity import Pixels, Plane

SURROUNDED, MOST = 0.25, 0.5
"""The fallback's share in the mean: of a view with two views on each side, and of others, which the
light-field network upscales less well. On 48 views of four captured light fields, made small by bicubic interpolation,
it gains -0.04 to 0.5 dB over the network, 0.16 in the mean. Shares by the network's uncertainty are no better."""
FILTERED, UNFILTERED = 0.95, 1.05
"""Ratio of the difference after the filter to that after means, up to which a view counts as filtered, and from which
it doesn't; between them the share falls. On those light fields it is 0.5 to 1.01 after bicubic interpolation, but for
the corner of a grid of 15x15, where it is 1.09. Of samples and means it is 1.06 and more, on rendered views too; 0.98
once, where little detail is."""
BORDER = 2
"""Pixels along each border that are not compared: filters end there in different ways."""
WHOLE_ROWS, BANDS, BAND_ROWS = 128, 4, 16
"""Rows up to which a whole view is compared; of a larger one, so many bands of so many rows are, evenly spaced."""
FLAT = 1e-9
"""Sum of squared differences, of values in [0, 1], up to which a view counts as flat."""


def find_fallback_share(large: Pixels, small: Pixels, *, is_surrounded: bool) -> float:
    """The share of the fallback's picture in the mean with `large` `(scale*H, scale*W, C)`, which a light-field network
    made of the view `small` `(H, W, C)`: `SURROUNDED` or `MOST` where it was filtered, 0 where it was not or is flat.

    `is_surrounded`: whether there are two views on each side.
    """
    from PIL import Image  # the web process does without

    scale, peak, height = len(large) // len(small), float(np.iinfo(small.dtype).max), len(small)
    count = height if height <= WHOLE_ROWS else BAND_ROWS
    tops = [0] if count == height else np.linspace(0, height - count, BANDS).astype(int).tolist()
    after_filter = after_means = 0.0
    for top in tops:
        fine = Image.fromarray(compute_luma(large[scale * top : scale * (top + count)], peak))
        seen = compute_luma(small[top : top + count], peak)
        after_filter += _compare(fine.resize((seen.shape[1], count), Image.Resampling.BICUBIC), seen)
        after_means += _compare(fine.reduce(scale), seen)
    if after_means <= FLAT:
        return 0.0
    ratio = (after_filter / after_means) ** 0.5
    most = SURROUNDED if is_surrounded else MOST
    return float(most * np.clip((UNFILTERED - ratio) / (UNFILTERED - FILTERED), 0, 1))


def _compare(made: Image.Image, seen: Plane) -> float:
    """Sum of squared differences inside the border."""
    inside = (np.asarray(made) - seen)[BORDER:-BORDER, BORDER:-BORDER]
    return float(np.square(inside).sum(dtype=np.float64))
