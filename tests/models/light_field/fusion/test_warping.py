import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.fusion.warping import TAPS, pad_edges, warp_picture, weigh_taps
from ciir.models.single.interpolation import keys_kernel


def warp(picture, moved, axis, first_row=0):
    return warp_picture(pad_edges(picture, axis), moved, axis, first_row=first_row)


def warp_slowly(picture, moved, axis, first_row=0):
    """Cubic convolution at each place, one pixel after the other."""
    result = np.zeros(moved.shape)
    for y, x in np.ndindex(result.shape):
        if axis == 0:
            result[y, x] = interpolate_slowly(picture[:, x], first_row + y + moved[y, x])
        else:
            result[y, x] = interpolate_slowly(picture[first_row + y], x + moved[y, x])
    return result


def interpolate_slowly(line, place):
    place = min(max(place, -1.0), len(line))
    before = int(np.floor(place))
    kernel = keys_kernel(np.array([place - before - tap for tap in TAPS], float))
    return sum(
        weight * line[min(max(before + tap, 0), len(line) - 1)] for tap, weight in zip(TAPS, kernel, strict=True)
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from([0, 1]), st.integers(0, 3), st.sampled_from([(9, 11), (4, 1)]))
def test_equals_the_slow_reference(seed, axis, first_row, shape):
    random = np.random.default_rng(seed)
    picture = random.random(shape, np.float32)
    moved = random.normal(0, 4, (shape[0] - first_row, shape[1])).astype(np.float32)
    got = warp(picture, moved, axis, first_row)
    # Places are rounded to float32, by 1e-6 pixels, and a kernel's slope is at most about 1.
    np.testing.assert_allclose(got, warp_slowly(picture, moved, axis, first_row), atol=1e-5)


@pytest.mark.parametrize("by", [-20, -2, 0, 3, 20])
def test_whole_pixels_are_exact(by):
    picture = np.random.default_rng(0).random((8, 9), np.float32)
    moved = np.full((8, 9), by, np.float32)
    np.testing.assert_array_equal(warp(picture, moved, 1), picture[:, np.clip(np.arange(9) + by, 0, 8)])
    np.testing.assert_array_equal(warp(picture, moved, 0), picture[np.clip(np.arange(8) + by, 0, 7)])


def test_weights_are_keys_kernel():
    share = np.linspace(0, 1, 33, dtype=np.float32)
    got = np.array(weigh_taps(share))
    want = [keys_kernel(share.astype(float) - tap) for tap in TAPS]
    np.testing.assert_allclose(got, want, atol=1e-6)
    np.testing.assert_allclose(got.sum(axis=0), 1, atol=1e-6)
