"""Samples textures as OpenGL's `GL_LINEAR` and `GL_NEAREST` at level 0 define it (OpenGL 3.3, section 3.8.11)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.scene import Texture, Wrap


def wrap_indices(index: NDArray[np.int64], size: int, wrap: Wrap) -> NDArray[np.int64]:
    """Returns texel indices mapped into `[0, size)`: `repeat`, `mirror` (every second copy reversed) or `clamp`."""
    if wrap == "repeat":
        return index % size
    if wrap == "mirror":
        index = index % (2 * size)
        return np.minimum(index, 2 * size - 1 - index)
    return np.clip(index, 0, size - 1)


def sample_texture(texture: Texture, uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the colours of `texture` at `uv` `(n, 2)`, origin at its lower left corner: `(n, 4)` RGBA in [0, 1].

    Texel (row, column) has its centre at u = (column + 0.5) / width, v = 1 - (row + 0.5) / height.
    """
    height, width = texture.pixels.shape[:2]
    if texture.is_nearest:
        right, up = (np.floor(uv.astype(np.float64) * (width, height)).astype(np.int64)).T
        row = wrap_indices(height - 1 - up, height, texture.wrap_v)
        column = wrap_indices(right, width, texture.wrap_u)
        return texture.pixels[row, column].astype(np.float32) / np.float32(255.0)
    x = uv[:, 0].astype(np.float64) * width - 0.5
    y = (1.0 - uv[:, 1].astype(np.float64)) * height - 0.5
    left, top = np.floor(x), np.floor(y)
    # Repeated for the four channels: NumPy is several times as slow if an axis of four is broadcast.
    across, down = ((place - low).astype(np.float32).repeat(4) for place, low in ((x, left), (y, top)))  # (4 * n,)
    columns = [wrap_indices(left.astype(np.int64) + i, width, texture.wrap_u) for i in (0, 1)]
    rows = [wrap_indices(top.astype(np.int64) + i, height, texture.wrap_v) for i in (0, 1)]
    texels = np.ascontiguousarray(texture.pixels).view(np.uint32).ravel()  # whole RGBA: five times as fast to gather
    upper, lower = (
        texels.take(row * width + columns[0]).view(np.uint8) * (1 - across)
        + texels.take(row * width + columns[1]).view(np.uint8) * across
        for row in rows
    )
    result: NDArray[np.float32] = (upper * (1 - down) + lower * down) / np.float32(255.0)
    return result.reshape(-1, 4)
