import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ciir.models import back_projection
from ciir.models.back_projection import SAMPLING_NOISE, restore_luma, restore_means


def restore_slowly(large, small):
    """The same in float64, pixel by pixel."""
    rows, cols, channels = small.shape
    scale, peak = len(large) // rows, np.iinfo(small.dtype).max
    result = large.astype(float)
    for y, x, c in np.ndindex(rows, cols, channels):
        around = small[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2, c].astype(float)
        noise = SAMPLING_NOISE * np.ptp(around)
        cell = result[scale * y : scale * (y + 1), scale * x : scale * (x + 1), c]
        difference = small[y, x, c] - cell.mean()
        wanted = cell.mean() + difference**3 / (difference**2 + noise**2 + 1e-6)
        for _ in range(2):
            cell[:] = np.clip(cell + wanted - cell.mean(), 0, peak)
    return result


def make_pair(scale=2, dtype=np.uint8, seed=0):
    random = np.random.default_rng(seed)
    peak = np.iinfo(dtype).max
    small = random.integers(0, peak + 1, (5, 7, 3), dtype)
    return random.integers(0, peak + 1, (5 * scale, 7 * scale, 3), dtype), small


def average(large, scale):
    return large.reshape(len(large) // scale, scale, -1, scale, large.shape[2]).mean(axis=(1, 3))


def test_strips_make_no_seams(monkeypatch):
    large, small = make_pair()
    whole = restore_means(large, small)
    monkeypatch.setattr(back_projection, "STRIP_ROWS", 2)
    assert np.array_equal(restore_means(large, small), whole)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_it_equals_the_slow_reference(scale, dtype):
    large, small = make_pair(scale, dtype)
    found = restore_means(large, small)
    assert found.dtype == dtype
    assert np.abs(found - restore_slowly(large, small)).max() <= 0.51  # half a level of rounding, and float32


@given(arrays.arrays(np.uint8, (4, 5, 1)), st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_no_mean_moves_away(small, seed):
    large = np.random.default_rng(seed).integers(0, 256, (8, 10, 1), np.uint8)
    before, after = (np.abs(average(one, 2) - small) for one in (large, restore_means(large, small)))
    assert (after <= before + 0.5).all()  # rounding to whole levels


def test_a_picture_with_the_right_means_stays():
    small = make_pair()[1]
    large = small.repeat(2, axis=0).repeat(2, axis=1)
    assert np.array_equal(restore_means(large, small), large)


def test_grey_stays_grey():
    large, small = (picture[..., :1].repeat(3, axis=2) for picture in make_pair())
    restored = restore_means(large, small)
    assert np.ptp(restored, axis=2).max() == 0


def test_an_edge_that_was_placed_wrongly_comes_closer():
    """A long edge along the rows, half an input pixel off."""
    truth = np.zeros((12, 40, 1), np.uint8)
    truth[5:] = 200
    small = average(truth, 2).round().astype(np.uint8)
    wrong = np.roll(truth, 1, axis=0)
    error = np.square(wrong.astype(int) - truth).mean()
    assert np.square(restore_means(wrong, small).astype(int) - truth).mean() < 0.6 * error


def make_small(large, sampling):
    """Luma in [0, 255] as the view of half the size that shows `large` `(H, W)`, in float64 and by its definition."""
    height, width = (length // 2 for length in large.shape)
    if sampling == "means":
        return average(large[..., np.newaxis].astype(float), 2)[..., 0]
    return make_weights(height) @ large @ make_weights(width).T


def make_weights(length):
    """Keys' cubic with a = -0.5 over four pixels to each side of the middle of two, `(length, 2 * length)`."""
    distance = np.abs((np.arange(2 * length) + 0.5) / 2 - (np.arange(length)[:, np.newaxis] + 0.5))
    near = 1.5 * distance**3 - 2.5 * distance**2 + 1
    far = -0.5 * distance**3 + 2.5 * distance**2 - 4 * distance + 2
    weights = np.where(distance < 1, near, np.where(distance < 2, far, 0))
    return weights / weights.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("sampling", ["filter", "means"])
def test_restored_luma_fits_what_was_seen(sampling, dtype):
    peak = np.iinfo(dtype).max
    rows, cols = np.mgrid[:40, :60]
    truth = (0.5 + 0.3 * np.sin(rows / 3) * np.cos(cols / 4)) * peak
    small = np.rint(make_small(truth, sampling))[..., np.newaxis].astype(dtype)
    blurred = np.rint(small.repeat(2, axis=0).repeat(2, axis=1) * 0.9).astype(dtype)
    errors = [
        np.abs(make_small(restore_luma(blurred, small, sampling, gain=gain)[..., 0], sampling) - small[..., 0]).mean()
        for gain in (0, 0.5, 1)
    ]
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.15)
    assert errors[2] < errors[0] / 5


@pytest.mark.parametrize("sampling", ["filter", "means"])
def test_a_view_that_fits_stays(sampling):
    large = np.random.default_rng(2).integers(100, 150, (40, 60, 1), np.uint8).repeat(3, axis=2)
    small = np.rint(make_small(large[..., 0], sampling))[..., np.newaxis].astype(np.uint8).repeat(3, axis=2)
    found = restore_luma(large, small, sampling)
    assert np.abs(found.astype(int) - large).max() <= 1  # the small view is rounded
    assert np.ptp(found, axis=2).max() == 0


@pytest.mark.parametrize("sampling", ["filter", "means"])
def test_strips_of_luma_make_no_seams(sampling, monkeypatch):
    large, small = make_pair()
    large, small = (picture.repeat(6, axis=0) for picture in (large, small))
    whole = restore_luma(large, small, sampling)
    monkeypatch.setattr(back_projection, "STRIP_ROWS", 7)
    assert np.array_equal(restore_luma(large, small, sampling), whole)


@pytest.mark.parametrize("sampling", ["filter", "means"])
def test_differences_as_small_as_the_noise_are_mostly_left(sampling):
    small = np.full((20, 30, 1), 120, np.uint8)
    for off in (4, 40):
        large = np.full((40, 60, 1), 120 - off, np.uint8)
        changes = [restore_luma(large, small, sampling, noise=noise).astype(float) - large for noise in (0, 16 / 255)]
        shares = [change.mean() / off for change in changes]
        assert shares[0] == pytest.approx(1)
        assert shares[1] == pytest.approx(off**2 / (off**2 + 16**2), abs=0.5 / off)  # rounded to whole levels
