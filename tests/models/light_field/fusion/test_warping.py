import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.fusion.warping import TAPS, warp_picture, weigh_taps
from ciir.models.single.interpolation import keys_kernel


def warp_slowly(picture, down, right, first_row=0):
    """Cubic convolution at each place, one pixel after the other."""
    height, width = picture.shape
    result = np.zeros((down if down is not None else right).shape)
    for y, x in np.ndindex(result.shape):
        rows = [(first_row + y, 1.0)] if down is None else list_taps(first_row + y + down[y, x], height)
        cols = [(x, 1.0)] if right is None else list_taps(x + right[y, x], width)
        result[y, x] = sum(rw * cw * picture[row, col] for row, rw in rows for col, cw in cols)
    return result


def list_taps(place, length):
    place = min(max(place, -1.0), length)
    before = int(np.floor(place))
    kernel = keys_kernel(np.array([place - before - tap for tap in TAPS], float))
    return [(min(max(before + tap, 0), length - 1), weight) for tap, weight in zip(TAPS, kernel, strict=True)]


@given(st.integers(0, 2**32 - 1), st.sampled_from(["down", "right", "both"]), st.integers(0, 3))
def test_equals_the_slow_reference(seed, axes, first_row):
    random = np.random.default_rng(seed)
    picture = random.random((9, 11), np.float32)
    moved = random.normal(0, 4, (2, 9 - first_row, 11)).astype(np.float32)
    down, right = (None if axes == skipped else part for part, skipped in zip(moved, ("right", "down"), strict=True))
    got = warp_picture(picture, down, right, first_row=first_row)
    # Places are rounded to float32, by 1e-6 pixels, and a kernel's slope is at most about 1.
    np.testing.assert_allclose(got, warp_slowly(picture, down, right, first_row), atol=1e-5)


@pytest.mark.parametrize("by", [-2, 0, 3])
def test_whole_pixels_are_exact(by):
    picture = np.random.default_rng(0).random((8, 9), np.float32)
    moved = np.full((8, 9), by, np.float32)
    want = picture[:, np.clip(np.arange(9) + by, 0, 8)]
    np.testing.assert_array_equal(warp_picture(picture, None, moved), want)


def test_weights_are_keys_kernel():
    share = np.linspace(0, 1, 33, dtype=np.float32)
    got = np.array(weigh_taps(share))
    want = [keys_kernel(share.astype(float) - tap) for tap in TAPS]
    np.testing.assert_allclose(got, want, atol=1e-6)
    np.testing.assert_allclose(got.sum(axis=0), 1, atol=1e-6)
