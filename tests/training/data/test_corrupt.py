"""Blur, noise and JPEG of an LR picture."""

import numpy as np
import pytest

from ciir.training.data.corrupt import Corruption, blur_picture, compress_jpeg

ALL = (slice(None), slice(None))
FLAT = np.full((60, 60, 3), 128, np.uint8)


def test_a_blur_spreads_a_point_as_a_gaussian():
    """Its mean stays, its standard deviation is sigma's: what is cut off at 3 sigma is 1.4 % of it."""
    point = np.zeros((41, 41, 1))
    point[20, 20] = 1.0
    spread = blur_picture(point, 2.0)[..., 0]
    assert spread.sum() == pytest.approx(1.0)
    at = np.arange(41) - 20
    for axis in (0, 1):
        profile = spread.sum(axis)
        assert (profile * at).sum() == pytest.approx(0.0, abs=1e-12)
        assert np.sqrt((profile * at**2).sum()) == pytest.approx(2.0, rel=0.02)
    np.testing.assert_array_equal(blur_picture(point, 0.0), point)
    np.testing.assert_allclose(blur_picture(FLAT.astype(float), 1.3), FLAT)


def test_noise_has_no_mean_and_at_most_the_given_deviation():
    random = np.random.default_rng(3)
    deviations = []
    for _ in range(40):
        error = Corruption(noise=10.0)(FLAT, *ALL, random).astype(float) - 128
        assert abs(error.mean()) < 0.5  # 10 / sqrt(10800), five times
        deviations.append(error.std())
    assert max(deviations) < 10.5
    assert np.mean(deviations) == pytest.approx(5.0, abs=1.5)  # uniform from 0 to 10


def test_jpeg_loses_more_at_lower_quality():
    rough = np.random.default_rng(0).integers(0, 256, (40, 44, 3), dtype=np.uint8)
    losses = [np.abs(compress_jpeg(rough, quality).astype(float) - rough).mean() for quality in (10, 50, 100)]
    assert losses[0] > losses[1] > losses[2] > 0
    drawn = Corruption(jpeg=100)(rough, *ALL, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn, compress_jpeg(rough, 100))


def test_the_order_is_blur_noise_jpeg():
    """Blur after noise would smooth it; JPEG of the lowest quality after noise leaves blocks of 8x8."""
    noisy = Corruption(noise=40.0, blur=3.0)(FLAT, *ALL, np.random.default_rng(1)).astype(float)
    assert np.abs(np.diff(noisy, axis=0)).mean() > noisy.std()  # neighbours are independent: 1.13 times
    blocks = Corruption(noise=40.0, jpeg=1)(FLAT[:32, :32], *ALL, np.random.default_rng(1))
    assert blocks.shape == (32, 32, 3)


def test_nothing_is_done_where_nothing_is_asked():
    assert not Corruption()
    np.testing.assert_array_equal(
        Corruption()(FLAT, slice(1, 3), slice(4, 9), np.random.default_rng(0)), FLAT[1:3, 4:9]
    )
    assert [Corruption(blur=sigma).margin for sigma in (0.0, 0.3, 1.0, 1.5)] == [0, 1, 3, 5]
