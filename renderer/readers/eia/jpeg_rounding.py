"""Undoes part of the JPEG rounding of an elemental image array, in which brightness varies slowly from view to view.

A JPEG holds cosine coefficients of 8x8 pixels, rounded to multiples of steps, so their values are open within half a
step. Elemental images are often about as small as those blocks, so that the edges between them become errors of all
views. Each round therefore smooths brightness under each lens, by steps down the gradient of Huber's function of its
first and second differences, and then clips each coefficient to near its multiple. This is projected gradient descent,
a relative of Zakhor's filter and projection (IEEE Trans. Circuits Syst. Video Technol. 2(1), 1992). The multiples are
those nearest to the decoded pixels. They are the file's if the pixels were neither clipped, at black and white, nor
rounded by about a step.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.cores import count_available_cores

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.jpeg import Luma

    Floats = NDArray[np.float32]

BLOCK = 8
ROUNDS = 5
"""The number of rounds of smoothing and clipping."""
SLOPE, BEND, LIMIT = 0.22, 0.04, 1.5
"""Weights of first differences (slopes) and of second ones (bends) in smoothing, and the limit, in steps of a block's
mean, up to which each counts: larger differences are edges of objects."""
KEPT = np.float32(0.18)
"""How far, in steps, a coefficient may be from its multiple. If that of the decoded pixels is farther away, the
coefficient may be as far as that. Rounding leaves half a step open; with less, views come closer to what was
compressed."""
FAR_BEND, MAX_FAR_SHARE = 2.5, 0.3
"""A bend of more than the first number of steps of a block's mean is far. If a larger share of bends than the second
number is far, the array stays as it is: its views differ too much to be smooth under a lens. At qualities 50 to 95 the
share is up to 0.29 for most captured and rendered light fields, and 0.34 to 0.97 for drawn text, for unrelated views,
and for cameras far apart at qualities from 75. It is also over 0.3 for most arrays of quality 97 and more, and from
about 90 for those that were coarser JPEGs before."""
SAMPLED_LENSES, SAMPLED_PIXELS = 48, 24
"""The most lenses along each side of the array, and the most pixels along each side of a lens, that are searched for
bends."""
ROWS, COLS = 512, 512
"""Pixels that are processed at once, in whole blocks. For wider pieces BLAS would start threads of its own, and its
sums would depend on their number."""
AROUND = BLOCK * ROUNDS
"""The margin in pixels that is processed with a piece, because each round reaches a block further."""


class Restored(NamedTuple):
    """The result of `restore`."""

    pixels: NDArray[np.uint8]
    """The restored picture, `(H, W, C)`."""
    changed: int
    """The number of changed pixels."""
    most: int
    """The largest change, in levels."""


def restore(pixels: NDArray[np.uint8], luma: Luma, lens: tuple[int, int]) -> Restored:
    """Returns `pixels`, `(H, W, C)` of a JPEG with the brightness `luma`, with its rounding undone in part.

    `lens`: rows and columns of pixels under each lens, which divide the picture. The change of brightness is added to
    each channel, and the sum is clipped. Incomplete blocks at the right and lower edge stay as they are, and so does
    everything if views differ too much.
    """
    if _find_far_share(luma, lens) > MAX_FAR_SHARE:
        return Restored(pixels, 0, 0)
    height, width = (side // BLOCK * BLOCK for side in luma.pixels.shape)
    result = pixels.copy()

    def restore_piece(corner: tuple[int, int]) -> tuple[int, int]:
        sides = zip(corner, (ROWS, COLS), (height, width), strict=True)
        inside = tuple(slice(start, min(start + length, end)) for start, length, end in sides)
        near = tuple(
            slice(max(0, part.start - AROUND), min(part.stop + AROUND, end))
            for part, end in zip(inside, luma.pixels.shape, strict=True)
        )
        change = _find_change(luma.pixels[near].astype(np.float32), luma.steps, _find_weights(near, lens))
        rows, cols = (
            slice(part.start - all_.start, part.stop - all_.start) for part, all_ in zip(inside, near, strict=True)
        )
        given = pixels[inside]
        made = np.rint(change[rows, cols]).astype(np.int16).repeat(given.shape[2], axis=1).reshape(given.shape)
        made += given
        result[inside] = np.clip(made, 0, 255, out=made)
        made -= given
        is_changed = np.logical_or.reduce([made[..., channel] for channel in range(given.shape[2])])
        return int(np.count_nonzero(is_changed)), int(max(made.max(), -made.min()))

    corners = [(top, left) for top in range(0, height, ROWS) for left in range(0, width, COLS)]
    with ThreadPoolExecutor(count_available_cores()) as pool:
        pieces = list(pool.map(restore_piece, corners))
    return Restored(result, sum(changed for changed, _ in pieces), max((most for _, most in pieces), default=0))


def _find_far_share(luma: Luma, lens: tuple[int, int]) -> float:
    """Returns the share of far bends in the middle of lenses, evenly spaced over the array.

    It is 1 if lenses have no bends because they have fewer than 3 pixels along both sides: such arrays stay as they
    are.
    """
    height, width = luma.pixels.shape
    picked = []
    for length, side in ((height, lens[0]), (width, lens[1])):
        count = length // side
        inside = min(side, SAMPLED_PIXELS)
        picked += [
            np.linspace(0, count - 1, min(count, SAMPLED_LENSES)).round().astype(np.intp),
            np.arange(inside) + (side - inside) // 2,
        ]
    lenses = luma.pixels.reshape(height // lens[0], lens[0], width // lens[1], lens[1])[np.ix_(*picked)]
    bends = [np.abs(np.diff(lenses.astype(np.int16), 2, axis)).ravel() for axis in (1, 3)]
    is_far = np.concatenate(bends) > FAR_BEND * luma.steps[0, 0]
    return float(is_far.mean()) if is_far.size else 1.0


class _Weights(NamedTuple):
    """Weights for smoothing pixels, row by row in one dimension, with those that are `offset` later and earlier."""

    offset: int
    slope: Floats
    """Weights of the difference from each pixel to the later one; 0 if that is under another lens."""
    bend: Floats
    """Weights of the difference between two differences multiplied by `slope`; 0 if a lens ends between them."""


def _find_weights(part: tuple[slice, ...], lens: tuple[int, int]) -> list[_Weights]:
    """Returns the weights for smoothing the pixels `part` down and across."""
    rows, cols = (np.arange(side.start + 1, side.stop + 1) % length for side, length in zip(part, lens, strict=True))
    cols[-1] = 0  # the next pixel is in the next row
    found = []
    for offset, joined in ((len(cols), rows.repeat(len(cols))), (1, np.tile(cols, len(rows)))):
        same_lens = (joined[:-offset] != 0).astype(np.float32)
        found.append(_Weights(offset, SLOPE * same_lens, BEND / SLOPE * same_lens[offset:] * same_lens[:-offset]))
    return found


def _find_change(luma: Floats, steps: Floats, weights: list[_Weights]) -> Floats:
    """Returns what is added to `luma` in its whole blocks, which begin at its upper left corner. `weights` smooth."""
    height, width = (side // BLOCK * BLOCK for side in luma.shape)
    luma = luma - 128  # as coefficients are stored
    steps = np.tile(steps, (1, width // BLOCK))  # for a row of blocks
    coefficients = _transform(luma[:height, :width])
    multiples = coefficients / steps
    np.rint(multiples, out=multiples)
    multiples *= steps
    low, high = multiples - KEPT * steps, multiples + KEPT * steps
    np.minimum(low, coefficients, out=low)
    np.maximum(high, coefficients, out=high)
    restored, scratch = luma.copy(), np.empty_like(luma)
    blocks = restored[:height, :width]
    limit = float(LIMIT * steps[0, 0])
    for _ in range(ROUNDS):
        _smooth(restored, weights, limit, scratch)
        _transform(blocks, out=coefficients)
        np.clip(coefficients, low, high, out=coefficients)
        _transform_back(coefficients, out=blocks)
    blocks -= luma[:height, :width]
    return blocks


def _smooth(luma: Floats, weights: list[_Weights], limit: float, scratch: Floats) -> None:
    """Moves pixels towards their neighbours under the same lens, down and then across, in place; fills `scratch`."""
    pixels, flat = luma.reshape(-1), scratch.reshape(-1)
    for offset, of_slope, of_bend in weights:
        slope = np.subtract(pixels[offset:], pixels[:-offset], out=flat[offset:])
        slope *= of_slope
        bend = slope[offset:] - slope[:-offset]
        bend *= of_bend
        np.clip(bend, -BEND * limit, BEND * limit, out=bend)
        np.clip(slope, -SLOPE * limit, SLOPE * limit, out=slope)
        slope[:-offset] -= bend
        slope[offset:] += bend
        pixels[:-offset] += slope
        pixels[offset:] -= slope


def _transform(pixels: Floats, out: Floats | None = None) -> Floats:
    """Returns the coefficients of each block, in its place, `(rows of blocks, 8, width)`."""
    height, width = pixels.shape
    down = COSINES @ pixels.reshape(-1, BLOCK, width)
    out = np.empty_like(down) if out is None else out
    np.matmul(down.reshape(height, -1, BLOCK), COSINES.T, out=out.reshape(height, -1, BLOCK))
    return out


def _transform_back(coefficients: Floats, out: Floats) -> None:
    rows, _, width = coefficients.shape
    down = COSINES.T @ coefficients
    np.matmul(down.reshape(rows * BLOCK, -1, BLOCK), COSINES, out=down.reshape(rows * BLOCK, -1, BLOCK))
    out[:] = down.reshape(-1, width)


def _make_cosines() -> Floats:
    """Returns the orthonormal cosine transform of `BLOCK` values: a row for each coefficient (ITU-T T.81, A.3.3)."""
    frequency, place = np.mgrid[:BLOCK, :BLOCK]
    waves = np.cos((2 * place + 1) * frequency * np.pi / (2 * BLOCK)) / 2
    waves[0] /= np.sqrt(2)
    return np.asarray(waves, np.float32)


COSINES = _make_cosines()
