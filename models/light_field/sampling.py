"""Finds how the pixels of a view were sampled, from what a light-field network made of it.

A network's picture fits its input: made small again in the same way, it is close to it. Two ways are compared: an
antialiasing filter, as that of bicubic interpolation, and means of cells, which are what lenslets and sensors see.
Points, which are what pinholes see, fit neither, and noise and the errors of a JPEG both equally badly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.back_projection import measure_contrast
from ciir.models.light_field.network import compute_luma

if TYPE_CHECKING:
    from ciir.models.back_projection import SamplingKind
    from ciir.models.light_field.disparities.shifts import Pixels, Plane

FILTERED, UNFILTERED = 0.95, 1.05
"""Ratio of the difference after the filter to that after means, up to which a view counts as filtered, and from which
it doesn't. On 48 views of four captured light fields it is 0.5 to 1.01 after bicubic interpolation, but for the corner
of a grid of 15x15, where it is 1.09. Of samples and means it is 1.06 and more, on rendered views too; 0.98 once, where
little detail is."""
NOT_MEANS, MEANS = 1.2, 1.3
"""The same ratio, up to which a view doesn't count as means, and from which it does."""
UNSURE = (FILTERED, 1.1), (NOT_MEANS, MEANS)
"""The same ratio, where a view may have been sampled otherwise than it looks: after bicubic interpolation it is up to
1.07 at corners of a light field in which the network knows much, 0.75 in the middle."""
CLEAN = {"filter": (0.036, 0.046), "means": (0.046, 0.056)}
"""Difference after the filter or means over the mean range of 3x3 pixels, up to which a view counts as clean, and from
which it doesn't. On those views it is 0.013 to 0.031 after the filter and 0.023 to 0.048 of means, but for that
corner; 0.066 and more of points, and 0.09 and more of 66 rendered views with pinholes."""
ERRORS = {"filter": 0.0, "means": 3.0}
"""Standard errors of a pixel up to which a difference is mostly left. In 141 cases of the harm benchmark with means 0
gains up to 0.2 dB more and loses up to 0.4 where views are JPEGs; 10 gains 0.1 less."""
BORDER = 2
"""Pixels along each border that are not compared: filters end there in different ways."""
WHOLE_ROWS, BANDS, BAND_ROWS = 128, 4, 16
"""Rows up to which a whole view is compared; of a larger one, so many bands of so many rows are, evenly spaced."""
MEDIAN = 0.6745
"""Median of the size of normal noise, in its standard deviations."""
FLAT = 1e-9
"""Sum of squared differences, or of ranges, of values in [0, 1], up to which a view counts as flat."""


class Sampling(NamedTuple):
    """How a view looks as if it was sampled."""

    kind: SamplingKind
    likeness: float
    """How much it looks like that, in (0, 1]."""
    gain: float
    """How much of a difference to what was seen to undo, in [0, 1]: 0 where much is noise."""
    noise: float
    """Size of differences that are noise, in luma of [0, 1]."""


class Finding(NamedTuple):
    """How a view was sampled, and whether that is certain."""

    sampling: Sampling | None
    """None where a view looks like neither kind, or is flat."""
    is_sure: bool = True
    """False where its pixels could be either (`UNSURE`)."""


def find_sampling(large: Pixels, small: Pixels) -> Finding:
    """How the view `small` `(H, W, C)` was sampled, of which a network made `large` `(scale*H, scale*W, C)`; either may
    be of 8 or 16 bits.
    """
    from PIL import Image  # the web process does without

    scale, height = len(large) // len(small), len(small)
    peak, small_peak = (float(np.iinfo(picture.dtype).max) for picture in (large, small))
    count = height if height <= WHOLE_ROWS else BAND_ROWS
    tops = [0] if count == height else np.linspace(0, height - count, BANDS).astype(int).tolist()
    differences: dict[SamplingKind, list[Plane]] = {"filter": [], "means": []}
    ranges = []
    for top in tops:
        fine = Image.fromarray(compute_luma(large[scale * top : scale * (top + count)], peak))
        seen = compute_luma(small[top : top + count], small_peak)
        made = {"filter": fine.resize((seen.shape[1], count), Image.Resampling.BICUBIC), "means": fine.reduce(scale)}
        for kind, parts in differences.items():
            parts.append(_crop_border(np.asarray(made[kind]) - seen))
        ranges.append(_crop_border(measure_contrast(seen)))
    sums = {kind: sum(map(_add_squares, parts)) for kind, parts in differences.items()}
    contrast = sum(map(_add_squares, ranges))
    if min(sums["means"], contrast) <= FLAT:
        return Finding(None)
    ratio = (sums["filter"] / sums["means"]) ** 0.5
    filtered, means = 1 - _rise(ratio, FILTERED, UNFILTERED), _rise(ratio, NOT_MEANS, MEANS)
    kind, likeness = ("filter", filtered) if filtered else ("means", means)
    is_sure = not any(low < ratio < high for low, high in UNSURE)
    if not likeness:
        return Finding(None, is_sure)
    cleanness = 1 - _rise((sums[kind] / contrast) ** 0.5, *CLEAN[kind])
    error = np.median(np.abs(np.concatenate([part.ravel() for part in differences[kind]]))) / MEDIAN
    return Finding(Sampling(kind, likeness, likeness * cleanness, ERRORS[kind] * float(error)), is_sure)


def _crop_border(plane: Plane) -> Plane:
    return plane[BORDER:-BORDER, BORDER:-BORDER]


def _add_squares(plane: Plane) -> float:
    return float(np.square(plane).sum(dtype=np.float64))


def _rise(value: float, start: float, end: float) -> float:
    """From 0 at `start` to 1 at `end`."""
    return float(np.clip((value - start) / (end - start), 0, 1))
