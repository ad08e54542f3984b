"""Back-projection: corrects an upscaled view so that it matches the input more closely when downscaled again.

Irani and Peleg, "Improving resolution by image registration" (CVGIP 53(3), 1991), for one view whose sampling is known.
The picture that the lenses would see of the network's result is compared with the one that they saw, and the difference
is added to the result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from ciir.models.light_field.network import compute_luma

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels

Value = TypeVar("Value", np.uint8, np.uint16)
SamplingKind = Literal["filter", "means"]
"""How a view was sampled: by the antialiasing filter of bicubic interpolation, or as means over the pixels' cells, as
lenslets and sensors do."""

SAMPLING_NOISE = 0.1
"""Standard error of a pixel, as a share of the range of its neighbouring pixels. A mean of 4x4 samples is off by up to
an eighth of the contrast at an edge along its rows, and by 0.07 of it in the root mean square."""
STRIP_ROWS = 64
"""Rows of the input that are processed at once, so that memory doesn't grow with the view."""
MARGIN = 4
"""Rows of the input, on each side of a strip, that the filter's result depends on."""
_ROUNDS = 2  # the second one gives what clipping takes from a pixel to the others of its cell
_TINY = 1e-6  # levels squared
_NEGLIGIBLE = 1e-9  # of luma in [0, 1], squared


def restore_means(large: NDArray[Value], small: NDArray[Value]) -> NDArray[Value]:
    """Brings the mean of each `scale x scale` pixels of `large` `(scale*H, scale*W, C)` closer to the pixel of `small`
    `(H, W, C)`, from which it was made.

    A difference d is weighted by d^2 / (d^2 + noise^2), as in a Wiener filter, with `SAMPLING_NOISE`. Where nothing
    differs, nothing changes.
    """
    scale = len(large) // len(small)
    result = np.empty_like(large)
    for top in range(0, len(small), STRIP_ROWS):
        bottom, first = min(top + STRIP_ROWS, len(small)), max(top - 1, 0)
        seen = small[first : bottom + 1].astype(np.float32)  # with a row on each side, for their range
        noise = SAMPLING_NOISE * measure_contrast(seen)
        rows, part = slice(top - first, bottom - first), slice(scale * top, scale * bottom)
        result[part] = _restore(large[part].astype(np.float32), seen[rows], noise[rows], np.iinfo(small.dtype).max)
    return result


def restore_luma(
    large: Pixels, small: Pixels, sampling: SamplingKind, *, gain: float = 1.0, noise: float = 0.0
) -> Pixels:
    """Brings the luma of `large` `(scale*H, scale*W, C)` closer to that of `small` `(H, W, C)`, from which it was made,
    by the share `gain` in [0, 1] of the difference. Either may have 8 or 16 bits.

    `sampling`: how `small` was sampled. A difference d of luma in [0, 1] is weighted by d^2 / (d^2 + noise^2).
    """
    from PIL import Image  # imported here because the web process doesn't need it

    scale, cubic = len(large) // len(small), Image.Resampling.BICUBIC
    peak, small_peak = (float(np.iinfo(picture.dtype).max) for picture in (large, small))
    result = np.empty_like(large)
    for top in range(0, len(small), STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, len(small))
        first, last = max(top - MARGIN, 0), min(bottom + MARGIN, len(small))
        fine = Image.fromarray(compute_luma(large[scale * first : scale * last], peak))
        seen = compute_luma(small[first:last], small_peak)
        size = (small.shape[1], last - first)
        made = fine.resize(size, cubic) if sampling == "filter" else fine.reduce(scale)
        difference = seen - np.asarray(made)
        power = np.square(difference)
        difference *= np.float32(gain * peak) * (power / (power + np.float32(noise**2 + _NEGLIGIBLE)))
        way = cubic if sampling == "filter" else Image.Resampling.NEAREST
        added = np.asarray(Image.fromarray(difference).resize(fine.size, way))
        rows = slice(scale * top, scale * bottom)
        given = large[rows]
        change = np.rint(added[scale * (top - first) :][: len(given)]).astype(np.int16 if peak < 256 else np.int32)
        # Repeated for the channels, because NumPy is several times slower when it broadcasts an axis of three.
        values = change.repeat(given.shape[2], axis=1).reshape(given.shape)
        values += given
        result[rows] = np.clip(values, 0, int(peak), out=values)
    return result


def _restore(
    values: NDArray[np.float32], seen: NDArray[np.float32], noise: NDArray[np.float32], peak: int
) -> NDArray[np.float32]:
    """Does the work of `restore_means` on one strip, and returns whole levels."""
    scale = len(values) // len(seen)
    means = _average_cells(values, scale)
    difference = seen - means
    power = np.square(difference)
    means += difference * (power / (power + np.square(noise) + np.float32(_TINY)))
    for _ in range(_ROUNDS):
        values += (means - _average_cells(values, scale)).repeat(scale, axis=0).repeat(scale, axis=1)
        np.clip(values, 0, peak, out=values)
    return np.rint(values, out=values)


def _average_cells(values: NDArray[np.float32], scale: int) -> NDArray[np.float32]:
    cells = [values[row::scale, col::scale] for row in range(scale) for col in range(scale)]
    total: NDArray[np.float32] = np.add(cells[0], cells[1]) if scale > 1 else cells[0].copy()
    for cell in cells[2:]:
        total += cell
    total *= np.float32(1 / scale**2)
    return total


def measure_contrast(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the largest minus the smallest of the 3x3 pixels around each pixel of `(H, W)`, or of each channel of
    `(H, W, C)`.
    """
    largest, smallest = picture, picture
    for axis in (0, 1):
        largest, smallest = (
            reduce_neighbours(one, axis, by) for one, by in ((largest, np.maximum), (smallest, np.minimum))
        )
    return largest - smallest


def reduce_neighbours(picture: NDArray[np.float32], axis: int, by: np.ufunc) -> NDArray[np.float32]:
    """Applies `by` to each pixel and its two neighbours along `axis`."""
    result = picture.copy()
    to, of = np.moveaxis(result, axis, 0), np.moveaxis(picture, axis, 0)
    by(to[1:], of[:-1], out=to[1:])
    by(to[:-1], of[1:], out=to[:-1])
    return result
