"""Takes point samples and their means over a lens, the same for both backends, by view and by lens.

For a pinhole, a pixel of view (v, u) is the colour that one ray hits, from the lens's centre in the direction of pixel
(v, u)'s centre. For a lenslet, it is the mean, in 8-bit display values, of `samples x samples` such rays, which start
on a regular grid over the lens cell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_SAMPLES = 16
LENSLET_SAMPLES = 4
"""Samples along each side of a lens cell for a lenslet, and for a pixel of a clean picture."""
DISPLAY_SAMPLES = 2
"""The same for a pixel of a quilt, and for a subpixel of a panel: with one ray each, a panel stays below 35 dB."""


def check_samples(samples: int) -> None:
    """Raises `InvalidOption` if `samples` is out of range."""
    if not 1 <= samples <= MAX_SAMPLES:
        raise InvalidOption(f"samples: {samples} is out of range; give 1 to {MAX_SAMPLES} along each side of a lens")


def average_cells(picture: NDArray[np.uint8], samples: int) -> NDArray[np.uint8]:
    """Returns the rounded mean over each lens cell, `(rows, cols, c)`, of point samples
    `(samples*rows, samples*cols, c)`; at most `MAX_SAMPLES` along each side.
    """
    if samples == 1:
        return picture
    height, width, channels = picture.shape
    # One axis after the other, columns slice by slice: NumPy's sum over both takes 15 times as long.
    rows = picture.reshape(height // samples, samples, width * channels).sum(axis=1, dtype=np.uint16)
    columns = rows.reshape(height // samples, width // samples, samples, channels)
    total = columns[:, :, 0].copy()
    for start in range(1, samples):
        total += columns[:, :, start]
    return _divide(total, samples**2)


def average_pictures(pictures: NDArray[np.uint8], *, axes: tuple[int, ...]) -> NDArray[np.uint8]:
    """Returns the mean over `axes`, rounded to the nearest integer, halves up."""
    count = int(np.prod([pictures.shape[axis] for axis in axes]))
    return _divide(pictures.sum(axis=axes, dtype=np.uint32), count)


def _divide(total: NDArray[np.unsignedinteger], count: int) -> NDArray[np.uint8]:
    """Returns `total / count`, rounded to the nearest integer, halves up. 16 bits hold the sum of `MAX_SAMPLES` by
    `MAX_SAMPLES` levels, and half their number.
    """
    mean: NDArray[np.uint8] = ((total + total.dtype.type(count // 2)) // total.dtype.type(count)).astype(np.uint8)
    return mean
