"""Undoes part of the rounding of an elemental image array that is a JPEG: brightness varies slowly from view to view.

A JPEG holds cosine coefficients of 8x8 pixels, rounded to multiples of steps; what was rounded is open within half a
step. Elemental images are often about as small as those blocks, so that the edges between them become errors of all
views. Of what may have been rounded, this takes something smooth under each lens: smoothing there and clipping the
coefficients to their intervals take turns, which is projection onto convex sets (Zakhor, IEEE Trans. Circuits Syst.
Video Technol. 2(1), 1992). The multiples are those nearest to the decoded pixels: they are the file's where these were
neither clipped, at black and white, nor rounded by about a step.
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
ROUNDS, SIDE_WEIGHT = 3, np.float32(0.2)
"""How often the two take turns, and the weight of either neighbour in smoothing."""
KEPT = np.float32(0.2)
"""How far, in steps, a coefficient may be from its multiple, or from the decoded pixels if these are farther."""
DOUBTFUL, WRONG = 0.06, 0.14
"""Share of a block's coefficients, averaged with the blocks around it, that smoothing moves by over half a step: up to
the first the result is taken, from the second the block stays. Views that differ much are not smooth under a lens."""
ROWS, COLS = 256, 512
"""Pixels that are worked on at once, whole blocks. Of wider pieces BLAS would start threads of its own, and its sums
would depend on their number."""
AROUND = BLOCK * ROUNDS
"""Pixels around a piece that are worked on with it: each round reaches a block further."""


class Restored(NamedTuple):
    """What `restore` made."""

    pixels: NDArray[np.uint8]
    """`(H, W, C)`."""
    changed: int
    """How many pixels."""
    most: int
    """By how many levels, at most."""


def restore(pixels: NDArray[np.uint8], luma: Luma, lens: tuple[int, int]) -> Restored:
    """`pixels`, `(H, W, C)` of a JPEG with the brightness `luma`, with its rounding undone in part.

    `lens`: rows and columns of pixels under each lens, which divide the picture. The change of brightness is added to
    each channel, and the sum clipped. Blocks at the right and lower edge of which the picture holds a part stay.
    """
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
        given, made = pixels[inside], result[inside]
        made[:] = np.clip(np.rint(given + change[rows, cols, np.newaxis]), 0, 255)
        difference = np.maximum(made, given) - np.minimum(made, given)
        return int(np.count_nonzero(difference.any(axis=2))), int(difference.max())

    corners = [(top, left) for top in range(0, height, ROWS) for left in range(0, width, COLS)]
    with ThreadPoolExecutor(count_available_cores()) as pool:
        counts = list(pool.map(restore_piece, corners))
    return Restored(result, sum(count for count, _ in counts), max((most for _, most in counts), default=0))


def _find_weights(part: tuple[slice, ...], lens: tuple[int, int]) -> list[Floats]:
    """For rows `(h - 1, 1)` and columns `(w - 1)` of `part`: the weight that each and its next have for each other."""
    joined = []
    for side, length in zip(part, lens, strict=True):
        is_last = np.arange(side.start + 1, side.stop) % length == 0  # the next one is under another lens
        joined.append(np.where(is_last, np.float32(0), SIDE_WEIGHT))
    return [joined[0][:, np.newaxis], joined[1]]


def _find_change(luma: Floats, steps: Floats, weights: list[Floats]) -> Floats:
    """What is added to `luma` in its whole blocks, which begin at its upper left corner."""
    height, width = (side // BLOCK * BLOCK for side in luma.shape)
    stored = _transform(luma[:height, :width])
    steps = np.tile(steps, (1, width // BLOCK))  # of a row of blocks
    multiples = np.rint(stored / steps) * steps
    low = np.minimum(multiples - KEPT * steps, stored)
    high = np.maximum(multiples + KEPT * steps, stored)
    restored, taken = luma.copy(), np.zeros(luma.shape, np.float32)
    for number in range(ROUNDS):
        restored = _smooth(restored, weights)
        coefficients = _transform(restored[:height, :width])
        if number == 0:
            taken = _weigh(np.abs(coefficients - multiples) > steps / 2)
        restored[:height, :width] = _transform_back(np.clip(coefficients, low, high, out=coefficients))
    return taken * (restored - luma)[:height, :width]


def _smooth(luma: Floats, weights: list[Floats]) -> Floats:
    """Each pixel with its neighbours under the same lens, down and across."""
    down, across = weights
    flow = down * (luma[1:] - luma[:-1])
    smooth = luma.copy()
    smooth[:-1] += flow
    smooth[1:] -= flow
    flow = across * (smooth[:, 1:] - smooth[:, :-1])
    smooth[:, :-1] += flow
    smooth[:, 1:] -= flow
    return smooth


def _transform(pixels: Floats) -> Floats:
    """The coefficients of each block, in its place, `(rows of blocks, 8, width)`."""
    height, width = pixels.shape
    down = COSINES @ (pixels - 128).reshape(-1, BLOCK, width)
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
    taken: Floats = np.clip((WRONG - around) / np.float32(WRONG - DOUBTFUL), 0, 1)
    return taken.repeat(BLOCK, 0).repeat(BLOCK, 1)


def _make_cosines() -> Floats:
    """The orthonormal cosine transform of `BLOCK` values: a row for each coefficient (ITU-T T.81, A.3.3)."""
    frequency, place = np.mgrid[:BLOCK, :BLOCK]
    waves = np.cos((2 * place + 1) * frequency * np.pi / (2 * BLOCK)) / 2
    waves[0] /= np.sqrt(2)
    return np.asarray(waves, np.float32)


COSINES = _make_cosines()
