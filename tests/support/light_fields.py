"""Small light fields of two textured planes, their views in a wrong order, and as files."""

from __future__ import annotations

import numpy as np

from ciir.renderer.writers.pictures import encode

DISPARITIES = (-2, 3)
"""Of the upper and the lower half of `make_views`, pixels."""


def make_views(grid=(5, 5), *, side=96, disparities=DISPARITIES, noise=0.0, channels=1, dtype=np.uint8, seed=0):
    """Views of two textured planes at different depths, `(V, U, side, side, C)`, in the right order."""
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
    """`views`, which are in the right order, in another one."""
    turned = views[::-1] if order.endswith("axis") else views
    return turned.transpose(1, 0, 2, 3, 4) if order.startswith("transposed") else turned


def wind(views):
    """`views` with every other row reversed, as a gantry takes them that moves to and fro."""
    return np.stack([row[::-1] if v % 2 else row for v, row in enumerate(views)])


def is_same_light_field(one, other):
    """Whether the views are equal, or all of them in the opposite order."""
    return np.array_equal(one, other) or np.array_equal(one, other[::-1, ::-1])


def write_views(views, name):
    """Views as PNG files; `name`: of view (v, u)."""
    return {name(v, u): encode(np.ascontiguousarray(views[v, u]), ".png") for v, u in np.ndindex(*views.shape[:2])}
