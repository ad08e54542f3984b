"""Light fields of textured planes whose disparity is known to any fraction: sums of sines, which need no resampling."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

WAVES = 60
WAVELENGTHS = 4.0, 30.0
"""Pixels."""


def draw_layers(
    far: float, near: float | None = None, *, count: int = 5, size: tuple[int, int] = (120, 160), seed: int = 1
) -> NDArray[np.uint8]:
    """`(count, count, H, W, 3)` views of the depth sense of cameras: a plane of disparity `far` and before it a disc of
    disparity `near`, which covers a fifth of the view.
    """
    height, width = size
    y, x = np.arange(height), np.arange(width)
    views = np.empty((count, count, height, width, 3), np.uint8)
    for v, u in np.ndindex(count, count):
        place = np.array([v, u]) - (count - 1) / 2
        picture = _draw(y + far * place[0], x + far * place[1], seed)
        if near is not None:
            down, across = y + near * place[0], x + near * place[1]
            squares = np.add.outer((down - 0.4 * height) ** 2, (across - 0.35 * width) ** 2)
            is_inside = squares[..., np.newaxis] < (0.3 * min(size)) ** 2
            picture = np.where(is_inside, _draw(down, across, seed + 1), picture)
        views[v, u] = np.rint(255 * picture.clip(0, 1))
    return views


def _draw(y: NDArray[np.float64], x: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """`(len(y), len(x), 3)` about 0.5, at any places."""
    random = np.random.default_rng(seed)
    frequency, angle = 2 * np.pi / random.uniform(*WAVELENGTHS, WAVES), random.uniform(0, 2 * np.pi, WAVES)
    phase = np.exp(2j * np.pi * random.uniform(0, 1, (3, WAVES)))
    down, across = (
        np.exp(1j * np.outer(frequency * part, at)) for part, at in ((np.sin(angle), y), (np.cos(angle), x))
    )
    total = np.einsum("ny,cn,nx->yxc", down, phase, across, optimize=True).imag
    result: NDArray[np.float64] = 0.5 + total / (2.2 * np.sqrt(WAVES))
    return result
