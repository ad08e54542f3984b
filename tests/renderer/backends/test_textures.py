"""Sampling against a reference that follows the OpenGL specification one sample at a time."""

import math

import numpy as np
import pytest

from ciir.renderer.backends.textures import sample_texture
from ciir.renderer.scene import Texture


def reference(texture, u, v):
    """OpenGL 3.3 core, section 3.8.11, with t counted from the bottom row as OpenGL does."""
    height, width = texture.pixels.shape[:2]
    x, t = u * width - 0.5, v * height - 0.5
    if texture.is_nearest:
        column, line = (math.floor(x + 0.5), math.floor(t + 0.5))
        row = height - 1 - slow_wrap(line, height, texture.wrap_v)
        return texture.pixels[row, slow_wrap(column, width, texture.wrap_u)] / 255
    total = np.zeros(4)
    for i in (0, 1):
        for j in (0, 1):
            column, line = math.floor(x) + i, math.floor(t) + j
            weight = (1 - abs(x - column)) * (1 - abs(t - line))
            column = slow_wrap(column, width, texture.wrap_u)
            line = slow_wrap(line, height, texture.wrap_v)
            total += weight * texture.pixels[height - 1 - line, column]
    return total / 255


def slow_wrap(index, size, wrap):
    if wrap == "clamp":
        return min(max(index, 0), size - 1)
    while index < 0:
        index += 2 * size
    if wrap == "repeat":
        return index % size
    index %= 2 * size
    return index if index < size else 2 * size - 1 - index


@pytest.mark.parametrize("wrap_u", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("wrap_v", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("is_nearest", [False, True])
def test_sample_is_that_of_opengl(wrap_u, wrap_v, is_nearest):
    random = np.random.default_rng(1)
    texture = Texture(random.integers(0, 256, (5, 7, 4), dtype=np.uint8), wrap_u, wrap_v, is_nearest)
    uv = random.uniform(-2.5, 2.5, (200, 2)).astype(np.float32)
    expected = [reference(texture, float(u), float(v)) for u, v in uv]
    # float32 weights on 8-bit values: a few times 2^-24
    np.testing.assert_allclose(sample_texture(texture, uv), expected, atol=2e-6)
