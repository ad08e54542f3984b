"""Finds the grid of an estimate with its offset, exact to a small part of a lens over the whole picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array

from ciir.renderer.readers.lenslet.grid import LensGrid, make_axes
from ciir.renderer.readers.lenslet.spectrum import FIRST, SPOTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.lenslet.spectrum import Estimate

BLOCK = 3.0
"""Length of a block's side in pitches. Blocks overlap by half."""
_STEPS = 13


def search_grid(signal: NDArray[np.float32], estimate: Estimate, *, keep_pitch: bool, keep_rotation: bool) -> LensGrid:
    """Finds the grid near `estimate` on which most blocks of `signal` agree, however strong each one is.

    `signal`: `(H, W)`, bright at lenses' centres, 0 where nothing shows them. Every block has a phase for each spot of
    the first ring. With the right pitch and rotation, the phases of a spot are the same in all blocks and give the
    offset.
    """
    pitch, rotation, shape = estimate.pitch, estimate.rotation, estimate.shape
    spots = SPOTS[shape][: FIRST[shape]]
    middle = (np.array(signal.shape) - 1) / 2
    lenses = min(signal.shape) / pitch
    for reach in (1.5, 0.25):  # lenses, over the whole picture
        steps = np.linspace(-reach, reach, _STEPS) / lenses
        scales = np.zeros(1) if keep_pitch else steps
        turns = np.zeros(1) if keep_rotation else steps  # radians
        sums = []
        for spot in spots @ make_axes(rotation) / pitch:
            phasors, y, x = _find_phasors(signal, spot, BLOCK * pitch)
            steady = phasors / (np.abs(phasors) + 0.5 * np.percentile(np.abs(phasors), 75) + 1e-12)
            turned = np.array([spot[1], -spot[0]])  # the derivative of a frequency with respect to the rotation
            drift = -spot * scales[:, None, None] + turned * turns[None, :, None]  # (scales, turns, 2)
            along_y = np.exp(-2j * np.pi * drift[..., :1] * (y - middle[0]))  # (scales, turns, blocks)
            along_x = np.exp(-2j * np.pi * drift[..., 1:] * (x - middle[1]))
            sums.append(np.einsum("sty,yx,stx->st", along_y, steady, along_x, optimize=True))
        found = np.unravel_index(np.abs(sums).sum(axis=0).argmax(), sums[0].shape)
        pitch *= float(np.exp(scales[found[0]]))
        rotation += float(np.rad2deg(turns[found[1]]))
    phases = np.array([np.angle(total[found]) for total in sums[:2]])
    offset = middle - np.linalg.solve(spots[:2] @ make_axes(rotation) / pitch, phases / (2 * np.pi))
    return LensGrid(pitch, (float(offset[0]), float(offset[1])), rotation, shape)


def _find_phasors(
    signal: NDArray[np.float32], frequency: NDArray[np.float64], side: float
) -> tuple[NDArray[np.complex64], NDArray[np.float64], NDArray[np.float64]]:
    """Returns the wave of `frequency` (y, x), in cycles per pixel, in each block, and the blocks' middles in y and in
    x.

    Phases refer to the wave at the picture's middle.
    """
    (over_y, y), (over_x, x) = (
        _make_windows(count, cycles, side) for count, cycles in zip(signal.shape, frequency, strict=True)
    )
    of_rows = over_y.real @ signal + 1j * (over_y.imag @ signal)  # a complex copy of the signal would be large
    return (over_x @ of_rows.T).T, y, x


def _make_windows(count: int, cycles: float, side: float) -> tuple[csr_array, NDArray[np.float64]]:
    """Returns Hann windows times a wave, `(blocks, count)`, and the windows' middles."""
    middle = (count - 1) / 2
    blocks = max(int(2 * count / side) - 1, 1)
    middles = middle + (np.arange(blocks) - (blocks - 1) / 2) * side / 2
    at = np.arange(count)
    distance = at - middles[:, None]
    windows = np.where(np.abs(distance) < side / 2, np.cos(np.pi * distance / side) ** 2, 0.0)
    wave = np.exp(-2j * np.pi * cycles * (at - middle))
    return csr_array((windows / windows.sum(axis=1, keepdims=True) * wave).astype(np.complex64)), middles
