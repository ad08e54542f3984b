"""Known shifts are found to a hundredth of a pixel."""

import pytest

pytest.importorskip("scipy", reason="needs the training extra")
import numpy as np
from scipy import ndimage

from ciir.benchmarks.parallax import disparities


def textured(seed):
    noise = np.random.default_rng(seed).normal(size=(90, 90))
    smooth = ndimage.gaussian_filter(noise, 1.5)
    return 128 + 60 * smooth / smooth.std() / 3


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("shift", [0.0, 0.3, -1.45, 3.8])
def test_a_shift_is_found(axis, shift):
    picture = textured(0)
    by = (shift, 0) if axis == 0 else (0, shift)
    found = disparities(picture, ndimage.shift(picture, by, order=5, mode="mirror"), axis)
    inner = found[1:-1, 1:-1]  # at the edge the shifted picture is made up
    assert np.isfinite(inner).all()
    assert np.abs(inner - shift).max() <= 0.02  # cubic splines of what a quintic moved


def test_flat_patches_and_strange_ones_tell_nothing():
    flat = np.full((90, 90), 100.0)
    assert np.isnan(disparities(flat, flat, 0)).all()
    assert np.isnan(disparities(textured(1), textured(2), 1)).mean() >= 0.9
