import math

import numpy as np
import pytest

from ciir.errors import InvalidImage, UnsupportedScale
from ciir.models.single.interpolation import SCALES, Bicubic, Nearest


def make_noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(7).random(shape, dtype=np.float32)


def slow_kernel(x: float) -> float:
    """Keys' kernel for a = -1/2, each piece multiplied out."""
    x = abs(x)
    if x <= 1:
        return 1.5 * x**3 - 2.5 * x**2 + 1
    return -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2 if x < 2 else 0.0


def slow_bicubic(plane: np.ndarray, scale: int) -> np.ndarray:
    """Both axes at once, one output pixel at a time, from the positions of sample centres."""
    height, width = plane.shape
    result = np.zeros((height * scale, width * scale))
    for row in range(height * scale):
        for col in range(width * scale):
            y, x = (row + 0.5) / scale - 0.5, (col + 0.5) / scale - 0.5
            for i in range(math.floor(y) - 1, math.floor(y) + 3):
                for j in range(math.floor(x) - 1, math.floor(x) + 3):
                    value = plane[min(max(i, 0), height - 1), min(max(j, 0), width - 1)]
                    result[row, col] += slow_kernel(y - i) * slow_kernel(x - j) * value
    return result.clip(0, 1)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("size", [(1, 1), (2, 5), (7, 4)])
def test_bicubic_against_the_slow_reference(scale, size):
    images = make_noise(2, 3, *size)
    got = Bicubic(scale)(images)
    want = np.array([[slow_bicubic(plane, scale) for plane in image] for image in images])
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, want, atol=1e-6)


@pytest.mark.parametrize("scale", SCALES)
def test_bicubic_phase(scale):
    """A ramp stays the same ramp at the centres of the smaller pixels; half a pixel off it would not."""
    ramp = np.broadcast_to(np.arange(16, dtype=np.float32) / 16, (1, 3, 16, 16))
    centres = ((np.arange(16 * scale) + 0.5) / scale - 0.5) / 16
    inside = slice(2 * scale, -2 * scale)
    got = Bicubic(scale)(np.ascontiguousarray(ramp))
    np.testing.assert_allclose(got[0, 0, 0, inside], centres[inside], atol=1e-6)
    got = Bicubic(scale)(np.ascontiguousarray(ramp.swapaxes(2, 3)))
    np.testing.assert_allclose(got[0, 0, inside, 0], centres[inside], atol=1e-6)


def test_bicubic_clips():
    edge = np.zeros((1, 3, 1, 8), np.float32)
    edge[..., 4:] = 1
    got = Bicubic(2)(edge)
    assert got.min() == 0.0
    assert got.max() == 1.0


@pytest.mark.parametrize("scale", SCALES)
def test_nearest_repeats(scale):
    images = make_noise(2, 3, 3, 5)
    got = Nearest(scale)(images)
    for p in range(scale):
        for q in range(scale):
            assert np.array_equal(got[:, :, p::scale, q::scale], images)


@pytest.mark.parametrize("kind", [Bicubic, Nearest])
def test_an_input_pixel_reaches_no_further_than_the_radius(kind):
    upscaler = kind(3)
    images = np.full((1, 3, 21, 21), 0.5, np.float32)
    before = upscaler(images)
    images[0, :, 10, 10] = 0.75
    changed = np.argwhere(upscaler(images) != before)[:, 2:] // 3
    assert np.abs(changed - 10).max() == upscaler.radius


@pytest.mark.parametrize("kind", [Bicubic, Nearest])
@pytest.mark.parametrize("scale", [-1, 0, 1, 9])
def test_scales_out_of_range(kind, scale):
    with pytest.raises(UnsupportedScale, match="give 2 to 8"):
        kind(scale)


@pytest.mark.parametrize("kind", [Bicubic, Nearest])
def test_input_is_checked(kind):
    with pytest.raises(InvalidImage):
        kind(2)(np.full((1, 3, 2, 2), np.nan, np.float32))


@pytest.mark.parametrize("kind", [Bicubic, Nearest])
def test_no_pictures(kind):
    assert kind(2)(make_noise(0, 3, 4, 5)).shape == (0, 3, 8, 10)
