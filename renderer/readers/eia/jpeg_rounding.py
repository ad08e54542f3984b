"""Undoes part of the rounding of an elemental image array that is a JPEG: brightness varies slowly from view to view.

A JPEG holds cosine coefficients of 8x8 pixels, rounded to multiples of steps; which values were rounded is open within
half a step. Elemental images are often about as small as those blocks, so that the edges between them become errors of
all views. Of the pictures that the file may stand for, this takes one that is smooth under each lens: smoothing there
and clipping the coefficients to their intervals take turns, which is projection onto convex sets (Zakhor, IEEE Trans.
Circuits Syst. Video Technol. 2(1), 1992). Coded again with the same steps, the result is the same file, but for the
rounding of pixels.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from ciir.cores import count_available_cores

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.jpeg import Luma

    Floats = NDArray[np.float32]

BLOCK = 8
ROUNDS, SIDE_WEIGHT = 3, np.float32(0.2)
"""How often the two take turns, and the weight of either neighbour in smoothing."""
KEPT = np.float32(0.2)
"""How far, in steps, a coefficient may be from the multiple that the file holds; half a step would be possible."""
DOUBTFUL, WRONG = 0.06, 0.14
"""Share of a block's coefficients, averaged with the blocks around it, that smoothing moves by over half a step: up to
the first the result is taken, from the second the block stays. Views that differ much are not smooth under a lens."""
STRIP_PIXELS = 1 << 18
"""About as many pixels are worked on at once, to save memory."""


def restore(pixels: NDArray[np.uint8], luma: Luma, lens: tuple[int, int]) -> NDArray[np.uint8]:
    """`pixels`, `(H, W, C)` of a JPEG with the brightness `luma`, with its rounding undone in part.

    `lens`: rows and columns of pixels under each lens, which divide the picture. Colour stays as it is, and so do
    blocks at the right and lower edge of which the picture holds a part.
    """
    height, width = (side // BLOCK * BLOCK for side in luma.pixels.shape)
    result = pixels.copy()
    if not width:
        return result
    period = math.lcm(BLOCK, lens[0])
    rows = max(1, STRIP_PIXELS // luma.pixels.shape[1] // period) * period

    def restore_strip(top: int) -> None:
        part = result[top : min(top + rows, height), :width]
        change = _find_change(luma.pixels[top : top + rows].astype(np.float32), luma.steps, lens)
        part[:] = np.clip(np.rint(part + change[..., np.newaxis]), 0, 255)

    with ThreadPoolExecutor(count_available_cores()) as pool:
        list(pool.map(restore_strip, range(0, height, rows)))
    return result


def _find_change(luma: Floats, steps: Floats, lens: tuple[int, int]) -> Floats:
    """What is added to `luma`, rows of whole elemental images, in its whole blocks."""
    height, width = (side // BLOCK * BLOCK for side in luma.shape)
    stored = _transform(luma[:height, :width])
    steps = np.tile(steps, (1, width // BLOCK))  # of a row of blocks
    multiples = np.rint(stored / steps) * steps
    low, high = multiples - KEPT * steps, multiples + KEPT * steps
    restored, weight = luma.copy(), np.zeros(luma.shape, np.float32)
    for number in range(ROUNDS):
        restored = _smooth(restored, lens)
        coefficients = _transform(restored[:height, :width])
        if number == 0:
            weight = _weigh(np.abs(coefficients - multiples) > steps / 2)
        restored[:height, :width] = _transform_back(np.clip(coefficients, low, high, out=coefficients))
    return weight * (restored - luma)[:height, :width]


def _smooth(luma: Floats, lens: tuple[int, int]) -> Floats:
    """Each pixel with its neighbours under the same lens, down and across."""
    down = luma.reshape(-1, lens[0], luma.shape[1])
    across = _smooth_axis(down).reshape(-1, lens[1])[..., np.newaxis]
    return _smooth_axis(across).reshape(luma.shape)


def _smooth_axis(values: Floats) -> Floats:
    """Along axis 1 of three; beyond the ends the last values go on."""
    smooth = (1 - 2 * SIDE_WEIGHT) * values
    for there, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        smooth[:, there] += SIDE_WEIGHT * values[:, other]
    for end in (0, -1):
        smooth[:, end] += SIDE_WEIGHT * values[:, end]
    return smooth


def _transform(pixels: Floats) -> Floats:
    """The coefficients of each block, in its place."""
    height, width = pixels.shape
    down = COSINES @ (pixels - 128).reshape(-1, BLOCK, width)
    # Row by row: of a large product BLAS would start threads of its own.
    both: Floats = np.matmul(down.reshape(height, -1, BLOCK), COSINES.T, dtype=np.float32)
    return both.reshape(-1, BLOCK, width)


def _transform_back(coefficients: Floats) -> Floats:
    rows, _, width = coefficients.shape
    down = COSINES.T @ coefficients
    both: Floats = np.matmul(down.reshape(rows * BLOCK, -1, BLOCK), COSINES, dtype=np.float32)
    return both.reshape(-1, width) + np.float32(128)


def _weigh(is_moved: NDArray[np.bool_]) -> Floats:
    """How much of the result is taken, by pixel, from which coefficients `(rows of blocks, 8, width)` are moved."""
    moved = is_moved.reshape(len(is_moved), BLOCK, -1, BLOCK).mean((1, 3), dtype=np.float32)
    padded = np.pad(moved, 1, mode="edge")
    around: Floats = np.zeros_like(moved)
    for y, x in np.ndindex(3, 3):
        around += padded[y : y + len(moved), x : x + moved.shape[1]] / 9
    weight: Floats = np.clip((WRONG - around) / np.float32(WRONG - DOUBTFUL), 0, 1)
    return weight.repeat(BLOCK, 0).repeat(BLOCK, 1)


def _make_cosines() -> Floats:
    """The orthonormal cosine transform of `BLOCK` values: a row for each coefficient (ITU-T T.81, A.3.3)."""
    frequency, place = np.mgrid[:BLOCK, :BLOCK]
    waves = np.cos((2 * place + 1) * frequency * np.pi / (2 * BLOCK)) / 2
    waves[0] /= np.sqrt(2)
    return np.asarray(waves, np.float32)


COSINES = _make_cosines()
