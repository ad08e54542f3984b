"""Small light fields of textured planes, also with their views in a wrong order, and as files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.writers.pictures import encode

if TYPE_CHECKING:
    from numpy.typing import NDArray

DISPARITIES = (-2, 3)
"""Disparities of the upper and the lower half of `make_views`, pixels."""
WAVES = 60
"""Number of sines in a texture of `draw_layers`."""
WAVELENGTHS = 4.0, 30.0
"""Range of their wavelengths, pixels."""


def make_views(grid=(5, 5), *, side=96, disparities=DISPARITIES, noise=0.0, channels=1, dtype=np.uint8, seed=0):
    """Makes views of two textured planes at different depths, `(V, U, side, side, C)`, in the right order."""
    random = np.random.default_rng(seed)
    margin = max(map(abs, disparities)) * max(grid)
    texture = random.normal(size=(2, side + 2 * margin, side + 2 * margin))
    for axis in (1, 2):
        texture = texture + np.roll(texture, 1, axis) + np.roll(texture, -1, axis)
    texture *= 40 / texture.std()
    views = np.empty((*grid, side, side))
    for v, u in np.ndindex(*grid):
        for half, disparity in enumerate(disparities):
            rows = slice(half * side // 2, (half + 1) * side // 2)
            top, left = margin - disparity * (v - grid[0] // 2), margin - disparity * (u - grid[1] // 2)
            views[v, u, rows] = texture[half, top : top + side, left : left + side][rows]
    views = np.clip(128 + views + random.normal(0, noise or 1e-9, views.shape), 0, 255)
    pictures = np.repeat(np.rint(views)[..., None], channels, axis=4)
    return (pictures * (257 if dtype == np.uint16 else 1)).astype(dtype)


def put_in(order, views):
    """Puts `views`, which are in the right order, in another one."""
    turned = views[::-1] if order.endswith("axis") else views
    return turned.transpose(1, 0, 2, 3, 4) if order.startswith("transposed") else turned


def wind(views):
    """Reverses every other row of `views`, as taken by a gantry that moves back and forth."""
    return np.stack([row[::-1] if v % 2 else row for v, row in enumerate(views)])


def is_same_light_field(one, other):
    """Returns whether the views are equal, or all of them are in the opposite order."""
    return np.array_equal(one, other) or np.array_equal(one, other[::-1, ::-1])


def write_views(views, name):
    """Encodes views as PNG files. `name`: returns the name of view (v, u)."""
    return {name(v, u): encode(np.ascontiguousarray(views[v, u]), ".png") for v, u in np.ndindex(*views.shape[:2])}


def draw_layers(
    far: float, near: float | None = None, *, count: int = 5, size: tuple[int, int] = (120, 160), seed: int = 1
) -> NDArray[np.uint8]:
    """Draws views `(count, count, H, W, 3)` in the depth sense of cameras: a plane of disparity `far`, and in front of
    it a disc of disparity `near`, which covers a fifth of the view.
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
    """Draws a texture `(len(y), len(x), 3)` around 0.5, at any places."""
    random = np.random.default_rng(seed)
    frequency, angle = 2 * np.pi / random.uniform(*WAVELENGTHS, WAVES), random.uniform(0, 2 * np.pi, WAVES)
    phase = np.exp(2j * np.pi * random.uniform(0, 1, (3, WAVES)))
    down, across = (
        np.exp(1j * np.outer(frequency * part, at)) for part, at in ((np.sin(angle), y), (np.cos(angle), x))
    )
    total = np.einsum("ny,cn,nx->yxc", down, phase, across, optimize=True).imag
    result: NDArray[np.float64] = 0.5 + total / (2.2 * np.sqrt(WAVES))
    return result
