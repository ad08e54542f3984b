"""Makes a view from all the others: each pixel comes from the plane of its own disparity."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from ciir.bit_depth import count_unused_bits
from ciir.cores import count_available_cores
from ciir.errors import InvalidOption
from ciir.renderer.focus.kernels import make_taps
from ciir.renderer.focus.stereo.noise import DIFFERENCE, estimate_noise
from ciir.renderer.levels import drop_alpha

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.focus.disparity import DisparityMap


MARGIN = 0.25
"""How much more two views may differ than by noise alone, as a share of the noise. Measured with noise of 10 and 20
levels: a higher value lets views of wrong disparities count, a lower one gains nothing where disparities are right."""


def focus_everywhere(views: NDArray[Any], found: DisparityMap, weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the view of `found`, `(H, W, C)`, in the units of `views`, `(V, U, H, W, C)`: sharp everywhere, with less
    noise.

    It is the mean of all views with their `weights`, `(V, U)`, at each pixel's disparity. A view counts less where it
    differs from the view itself in the surrounding 3x3 pixels, because it sees something in front there or the
    disparity is wrong.

    Raises `InvalidOption` for a disparity map of another size than the views.
    """
    if found.disparity.shape != views.shape[2:4]:
        given, wanted = ("x".join(map(str, shape)) for shape in (found.disparity.shape, views.shape[2:4]))
        raise InvalidOption(f"disparity: {given} pixels, but the views have {wanted}; give the disparity of one view")
    own = views[found.view].astype(np.float32)
    noise = 2 * estimate_noise(views[found.view]) ** 2  # squared, for a difference
    level = np.iinfo(views.dtype).max / 255 / 2 ** count_unused_bits(views)
    tolerance = (DIFFERENCE * level) ** 2 + MARGIN * noise

    def add_row(v: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns the sum of a row of views and that of their shares, `(H, W, C)` and `(H, W)`."""
        total, count = np.zeros_like(own), np.zeros(own.shape[:2], np.float32)
        for u in np.flatnonzero(weights[v]):
            down, across = v - found.view[0], int(u) - found.view[1]
            samples, reached = _sample(views[v, u], down * found.disparity, across * found.disparity)
            squares = ndimage.uniform_filter(np.square(drop_alpha(samples - own)).mean(axis=2), 3, mode="nearest")
            share = weights[v, u] * reached * np.exp(-np.maximum(squares - noise, 0) / tolerance)
            total += share[..., np.newaxis] * samples
            count += share
        return total, count

    with ThreadPoolExecutor(count_available_cores()) as pool:
        totals, counts = zip(*pool.map(add_row, range(len(weights))), strict=True)
    count = np.add.reduce(counts)[..., np.newaxis]
    result: NDArray[np.float32] = np.where(count > 0, np.add.reduce(totals) / np.where(count > 0, count, 1), own)
    return result


def _sample(
    view: NDArray[Any], up: NDArray[np.float32], left: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns `view` sampled `up` and `left` of each pixel by Keys's kernel, `(H, W, C)`, and whether that is inside,
    `(H, W)`.
    """
    height, width, channels = view.shape
    rows, cols = np.arange(height)[:, np.newaxis] - up, np.arange(width) - left
    is_inside = (rows >= 0) & (rows <= height - 1) & (cols >= 0) & (cols <= width - 1)
    top, start = np.floor(rows), np.floor(cols)
    down, across = (np.moveaxis(make_taps(part), -1, 0).astype(np.float32, "C") for part in (rows - top, cols - start))
    lines, places = (
        [(first + offset).clip(0, length - 1).astype(np.intp) for offset in range(-1, 3)]
        for first, length in ((top, height), (start, width))
    )
    planes = np.ascontiguousarray(view.transpose(2, 0, 1), np.float32).reshape(channels, -1)
    samples = np.zeros((channels, height, width), np.float32)
    for line, share in zip(lines, down, strict=True):
        for place, part in zip(places, across, strict=True):
            weight, at = share * part, line * width + place
            for channel, plane in enumerate(planes):
                samples[channel] += weight * plane[at]
    return samples.transpose(1, 2, 0), is_inside
