"""Finds how the pixels of a view were sampled, from the picture that a light-field network made of it.

A network's picture fits its input: downscaled in the same way as the input was, it is close to it. Two ways are
compared: an antialiasing filter like that of bicubic interpolation, and means of cells, which lenslets and sensors
record. Points, which pinholes record, fit neither. Noise and the errors of a JPEG fit both equally badly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.back_projection import measure_contrast
from ciir.models.light_field.network import compute_luma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.models.back_projection import SamplingKind
    from ciir.models.light_field.disparities.shifts import Pixels, Plane

FILTERED, UNFILTERED = 0.95, 1.05
"""Limits of a ratio: the difference after the filter divided by that after means. Up to the first limit a view counts
as filtered, from the second it doesn't. On 48 views of four captured light fields the ratio is 0.5 to 1.01 after
bicubic interpolation, except 1.09 at the corner of a grid of 15x15. For samples and means, including rendered views, it
is at least 1.06, except 0.98 once, in a view with little detail."""
NOT_MEANS, MEANS = 1.2, 1.3
"""Limits of the same ratio: up to the first a view doesn't count as means, from the second it does."""
UNSURE = (FILTERED, 1.1), (NOT_MEANS, MEANS)
"""Intervals of the same ratio in which a view may have been sampled differently than it looks. After bicubic
interpolation it is up to 1.07 at the corners of a light field on which the network does well, 0.75 in the middle."""
CLEAN = {"filter": (0.036, 0.046), "means": (0.046, 0.056)}
"""Limits of the difference after the filter or means, divided by the mean range of 3x3 pixels. Up to the first a view
counts as clean, from the second it doesn't. On the views above it is 0.013 to 0.031 after the filter and 0.023 to 0.048
for means, except at that corner. It is at least 0.066 for points, and at least 0.09 on 66 views rendered with
pinholes."""
ERRORS = {"filter": 0.0, "means": 3.0}
"""Standard errors of a pixel up to which a difference is mostly left as it is. In 141 cases of the harm benchmark with
means, a value of 0 gains up to 0.2 dB more but loses up to 0.4 if views are JPEGs; 10 gains 0.1 less."""
BORDER = 2
"""Pixels along each border that are not compared, because filters treat the border differently."""
WHOLE_ROWS, BANDS, BAND_ROWS = 128, 4, 16
"""Most rows of a view that is compared as a whole; and for larger views, the number of evenly spaced bands that are
compared, and their rows."""
MEDIAN = 0.6745
"""Median of the absolute value of normal noise, in standard deviations."""
FLAT = 1e-9
"""Largest sum of squared differences, or of squared ranges, of values in [0, 1], of a view that counts as flat."""


class Sampling(NamedTuple):
    """How a view appears to have been sampled."""

    kind: SamplingKind
    likeness: float
    """How much it looks like that kind, in (0, 1]."""
    gain: float
    """The share of a difference from the input to undo, in [0, 1]; 0 if much of it is noise."""
    noise: float
    """The size of differences that are noise, in luma of [0, 1]."""


class Finding(NamedTuple):
    """How a view was sampled, and whether that is certain."""

    sampling: Sampling | None
    """None if the view looks like neither kind, or is flat."""
    is_sure: bool = True
    """False if its pixels could have been sampled in more than one way (`UNSURE`)."""


def find_sampling(large: Pixels, small: Pixels) -> Finding:
    """Finds how the view `small` `(H, W, C)` was sampled, from which a network made `large` `(scale*H, scale*W, C)`.
    Either may have 8 or 16 bits.
    """
    found = _compare(large, small, ("filter", "means"))
    sums, contrast = found.sums, found.contrast
    if min(sums["means"], contrast) <= FLAT:
        return Finding(None)
    ratio = (sums["filter"] / sums["means"]) ** 0.5
    kind: SamplingKind
    filtered, means = 1 - _rise(ratio, FILTERED, UNFILTERED), _rise(ratio, NOT_MEANS, MEANS)
    kind, likeness = ("filter", filtered) if filtered else ("means", means)
    is_sure = not any(low < ratio < high for low, high in UNSURE)
    if not likeness:
        return Finding(None, is_sure)
    cleanness = 1 - _rise((sums[kind] / contrast) ** 0.5, *CLEAN[kind])
    error = np.median(np.abs(np.concatenate([part.ravel() for part in found.differences[kind]]))) / MEDIAN
    return Finding(Sampling(kind, likeness, likeness * cleanness, ERRORS[kind] * float(error)), is_sure)


def measure_misfit(large: Pixels, small: Pixels) -> float:
    """Measures how badly the picture `large` `(scale*H, scale*W, C)` fits `small` `(H, W, C)`, from which it was made:
    its difference from `small` after the filter, divided by the range of 3x3 pixels, both as root mean squares.

    Either may have 8 or 16 bits, and alpha. The result is 0 for a flat picture, and infinite for one that is too small
    to compare.
    """
    if min(small.shape[:2]) <= 2 * BORDER:
        return float("inf")
    found = _compare(large, small, ("filter",), bands=4 * BANDS)
    return 0.0 if found.contrast <= FLAT else (found.sums["filter"] / found.contrast) ** 0.5


class _Comparison(NamedTuple):
    """Sums over the pixels that are compared; values are luma in [0, 1]."""

    differences: dict[SamplingKind, list[Plane]]
    """What `small` differs by from `large`, downscaled in that way, in bands."""
    sums: dict[SamplingKind, float]
    """Their squares' sums."""
    contrast: float
    """The sum of the squared ranges of 3x3 pixels of `small`."""


def _compare(large: Pixels, small: Pixels, kinds: Sequence[SamplingKind], *, bands: int = BANDS) -> _Comparison:
    """Compares `large`, downscaled in each of the ways `kinds`, with `small`: all of it, or some bands."""
    from PIL import Image  # imported here because the web process doesn't need it

    scale, height = len(large) // len(small), len(small)
    count = height if height <= max(WHOLE_ROWS, bands * BAND_ROWS) else BAND_ROWS
    tops = [0] if count == height else np.linspace(0, height - count, bands).astype(int).tolist()
    differences: dict[SamplingKind, list[Plane]] = {kind: [] for kind in kinds}
    contrast = 0.0
    for top in tops:
        fine = Image.fromarray(_show_luma(large[scale * top : scale * (top + count)]))
        seen = _show_luma(small[top : top + count])
        for kind, parts in differences.items():
            is_filter = kind == "filter"
            made = fine.resize((seen.shape[1], count), Image.Resampling.BICUBIC) if is_filter else fine.reduce(scale)
            parts.append(_crop_border(np.asarray(made) - seen))
        contrast += _add_squares(_crop_border(measure_contrast(seen)))
    sums = {kind: sum(map(_add_squares, parts)) for kind, parts in differences.items()}
    return _Comparison(differences, sums, contrast)


def _show_luma(picture: Pixels) -> Plane:
    """Returns the luma of a picture `(H, W, C)` in [0, 1], in front of black if it has alpha."""
    peak = float(np.iinfo(picture.dtype).max)
    if picture.shape[2] in (1, 3):
        return compute_luma(picture, peak)
    shown: Plane = compute_luma(picture[..., :-1], peak)
    shown *= picture[..., -1].astype(np.float32) / np.float32(peak)
    return shown


def find_common_means(samplings: Sequence[Sampling | None]) -> Sampling | None:
    """Returns the medians of those of `samplings` that are means, if more than half of them are; otherwise None."""
    means = [sampling for sampling in samplings if sampling and sampling.kind == "means"]
    if 2 * len(means) <= len(samplings):
        return None
    likeness, gain, noise = np.median([sampling[1:] for sampling in means], axis=0).tolist()
    return Sampling("means", likeness, gain, noise)


def _crop_border(plane: Plane) -> Plane:
    return plane[BORDER:-BORDER, BORDER:-BORDER]


def _add_squares(plane: Plane) -> float:
    return float(np.square(plane).sum(dtype=np.float64))


def _rise(value: float, start: float, end: float) -> float:
    """Returns 0 up to `start` and 1 from `end`, rising linearly in between."""
    return float(np.clip((value - start) / (end - start), 0, 1))
