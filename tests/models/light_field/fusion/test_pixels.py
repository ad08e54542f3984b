import numpy as np
import pytest
from scipy import ndimage

from ciir.models.light_field.fusion import pixels
from ciir.models.light_field.fusion.pixels import AROUND, DEVIATION, OWN_WEIGHT, PATCH, enlarge, fuse_lumas

AXES = pytest.mark.parametrize("axis", [0, 1])


def fuse_slowly(own, beside, disparity, axis):
    """The weighted mean of views moved by whole pixels."""
    total, weights = OWN_WEIGHT * own.astype(float), np.full(own.shape, float(OWN_WEIGHT))
    for offset, luma in beside.items():
        places = np.clip(np.arange(own.shape[axis]) + disparity * offset, 0, own.shape[axis] - 1)
        warped = luma.take(places, axis).astype(float)
        warped += average(own - warped, AROUND)
        weight = np.exp(-average((warped - own) ** 2, PATCH) / DEVIATION**2)
        total += weight * warped
        weights += weight
    return total / weights


def average(values, side):
    padded = np.pad(values, side // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, (side, side)).mean(axis=(2, 3))


@AXES
def test_equals_the_slow_reference(monkeypatch, axis):
    monkeypatch.setattr(pixels, "STRIP_ROWS", 7)
    random = np.random.default_rng(0)
    own = random.random((40, 30), np.float32)
    beside = {offset: (own + random.normal(0, 0.02, own.shape)).astype(np.float32) for offset in (-1, 1, 2)}
    for moved in (0, 1, -2):
        disparity = np.full((20, 15), moved / 2, np.float32)
        got = fuse_lumas(own, beside, disparity, axis)
        np.testing.assert_allclose(got, fuse_slowly(own, beside, moved, axis), atol=1e-5)


@AXES
def test_noise_falls_and_edges_stay(axis):
    random = np.random.default_rng(1)
    truth = np.zeros((32, 32), np.float32)
    truth[:, 16:] = 0.5
    own, before, after = ((truth + random.normal(0, 0.01, truth.shape)).astype(np.float32) for _ in range(3))
    fused = fuse_lumas(own, {-1: before, 1: after}, np.zeros((16, 16), np.float32), axis)
    # The weights of the others are nearly 1, and the view's own is 1.5: sqrt(1.5^2 + 1 + 1) / 3.5 = 0.59 is left.
    assert 0.53 < np.std(fused - truth) / np.std(own - truth) < 0.65
    assert abs(fused[:, 16].mean() - fused[:, 15].mean() - 0.5) < 0.01


@AXES
def test_views_of_other_content_do_not_count(axis):
    own, before, after = np.random.default_rng(0).random((3, 40, 40), np.float32) * 4  # of a contrast of about 1
    fused = fuse_lumas(own, {-1: before, 1: after}, np.zeros((20, 20), np.float32), axis)
    np.testing.assert_allclose(fused, own, atol=1e-3)


@AXES
def test_brightness_stays_that_of_the_view(axis):
    own = np.random.default_rng(0).random((60, 60), np.float32)
    darker = {-1: own - np.float32(0.1), 1: own - np.float32(0.4)}
    fused = fuse_lumas(own, darker, np.zeros((30, 30), np.float32), axis)
    np.testing.assert_allclose(fused, own, atol=1e-5)


@AXES
def test_flat_views_stay_as_they_are(axis):
    flat = np.full((20, 24), 77 / 255, np.float32)
    disparity = np.random.default_rng(0).normal(0, 3, (10, 12)).astype(np.float32)
    np.testing.assert_allclose(fuse_lumas(flat, {-1: flat, 1: flat}, disparity, axis), flat, rtol=3e-7)


def test_enlarging_is_linear_between_centres():
    plane = np.random.default_rng(0).random((5, 6), np.float32)
    want = ndimage.zoom(plane, 2, order=1, mode="nearest", grid_mode=True)
    np.testing.assert_allclose(enlarge(plane, 2), want, atol=1e-6)
