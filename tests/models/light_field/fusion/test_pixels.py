import numpy as np
from scipy import ndimage

from ciir.models.light_field.fusion import pixels
from ciir.models.light_field.fusion.pixels import AROUND, DEVIATION, OWN_WEIGHT, PATCH, enlarge, fuse_lumas

OFFSETS = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]


def fuse_slowly(own, around, disparity):
    """The weighted mean of views moved by whole pixels."""
    total, weights = OWN_WEIGHT * own.astype(float), np.full(own.shape, float(OWN_WEIGHT))
    for (down, right), luma in around.items():
        rows = np.clip(np.arange(len(own)) + disparity * down, 0, len(own) - 1)
        cols = np.clip(np.arange(own.shape[1]) + disparity * right, 0, own.shape[1] - 1)
        warped = luma[np.ix_(rows, cols)].astype(float)
        warped += average(own - warped, AROUND)
        weight = np.exp(-average((warped - own) ** 2, PATCH) / DEVIATION**2)
        total += weight * warped
        weights += weight
    return total / weights


def average(values, side):
    padded = np.pad(values, side // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, (side, side)).mean(axis=(2, 3))


def test_equals_the_slow_reference(monkeypatch):
    monkeypatch.setattr(pixels, "STRIP_ROWS", 7)
    random = np.random.default_rng(0)
    own = random.random((40, 30), np.float32)
    around = {offset: (own + random.normal(0, 0.02, own.shape)).astype(np.float32) for offset in OFFSETS}
    for moved in (0, 1, -2):
        disparity = np.full((20, 15), moved / 2, np.float32)
        got = fuse_lumas(own, around, disparity)
        np.testing.assert_allclose(got, fuse_slowly(own, around, moved), atol=1e-5)


def test_noise_falls_and_edges_stay():
    random = np.random.default_rng(1)
    truth = np.zeros((32, 32), np.float32)
    truth[:, 16:] = 0.5
    seen = {offset: (truth + random.normal(0, 0.01, truth.shape)).astype(np.float32) for offset in [(0, 0), *OFFSETS]}
    own = seen.pop((0, 0))
    fused = fuse_lumas(own, seen, np.zeros((16, 16), np.float32))
    # The weights of the others are nearly 1, and the view's own is 2: 2/10 + 8/10 of other noise, over 8 views.
    assert 0.3 < np.std(fused - truth) / np.std(own - truth) < 0.45
    assert abs(fused[:, 16].mean() - fused[:, 15].mean() - 0.5) < 0.01


def test_views_of_other_content_do_not_count():
    own, *others = np.random.default_rng(0).random((9, 40, 40), np.float32) * 4  # of a contrast of about 1
    fused = fuse_lumas(own, dict(zip(OFFSETS, others, strict=True)), np.zeros((20, 20), np.float32))
    np.testing.assert_allclose(fused, own, atol=1e-3)


def test_brightness_stays_that_of_the_view():
    random = np.random.default_rng(0)
    own = random.random((60, 60), np.float32)
    darker = {offset: own - np.float32(0.1 * number) for number, offset in enumerate(OFFSETS)}
    fused = fuse_lumas(own, darker, np.zeros((30, 30), np.float32))
    np.testing.assert_allclose(fused, own, atol=1e-5)


def test_flat_views_stay_as_they_are():
    flat = np.full((20, 24), 77 / 255, np.float32)
    disparity = np.random.default_rng(0).normal(0, 3, (10, 12)).astype(np.float32)
    np.testing.assert_allclose(fuse_lumas(flat, dict.fromkeys(OFFSETS, flat), disparity), flat, rtol=3e-7)


def test_enlarging_is_linear_between_centres():
    plane = np.random.default_rng(0).random((5, 6), np.float32)
    want = ndimage.zoom(plane, 2, order=1, mode="nearest", grid_mode=True)
    np.testing.assert_allclose(enlarge(plane, 2), want, atol=1e-6)
