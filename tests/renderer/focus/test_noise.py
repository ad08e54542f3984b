import numpy as np
import pytest

from ciir.renderer.focus.noise import estimate_noise


@pytest.mark.parametrize("noise", [2, 10])
def test_of_a_picture_with_edges(noise):
    picture = 50 + 100 * (np.indices((90, 120)).sum(axis=0) // 90)[..., np.newaxis] * np.ones(3)
    noisy = picture + np.random.default_rng(0).normal(0, noise, picture.shape)
    assert estimate_noise(noisy.clip(0, 255).round().astype(np.uint8)) == pytest.approx(
        noise, rel=0.15
    )  # edges add a little
