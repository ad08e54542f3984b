import numpy as np
import pytest
from scipy import ndimage

from ciir.renderer.focus.stereo.noise import estimate_noise, measure_blur


@pytest.mark.parametrize("noise", [2, 10])
def test_of_a_picture_with_edges(noise):
    picture = 50 + 100 * (np.indices((90, 120)).sum(axis=0) // 90)[..., np.newaxis] * np.ones(3)
    noisy = picture + np.random.default_rng(0).normal(0, noise, picture.shape)
    assert estimate_noise(noisy.clip(0, 255).round().astype(np.uint8)) == pytest.approx(
        noise, rel=0.15
    )  # edges add a little


@pytest.mark.parametrize(("sigma", "dtype"), [(0, np.uint8), (4, np.uint16), (12, np.uint8)])
def test_noise_is_found_beside_edges(sigma, dtype):
    view = np.full((96, 128, 3), 90.0)
    view[20:70, 30:90] = 200
    view += sigma * np.random.default_rng(7).standard_normal(view.shape)
    view = (view.clip(0, 255) * (np.iinfo(dtype).max / 255)).round().astype(dtype)
    assert estimate_noise(view) * 255 / np.iinfo(dtype).max == pytest.approx(sigma, rel=0.05, abs=0.1)


@pytest.mark.parametrize("channels", [1, 3])
def test_alpha_does_not_count(channels):
    view = np.random.default_rng(7).integers(100, 140, (60, 70, channels), dtype=np.uint8)
    alpha = np.full((60, 70, 1), 255, np.uint8)
    assert estimate_noise(np.concatenate([view, alpha], axis=2)) == estimate_noise(view) > 5


@pytest.mark.parametrize("deviation", [0, 0.3, 1])
def test_what_a_blur_leaves_of_noise(deviation):
    noise = np.random.default_rng(0).standard_normal((300, 300))
    assert ndimage.gaussian_filter(noise, deviation).std() == pytest.approx(measure_blur(deviation), rel=0.02)
