"""Known shifts are found to a hundredth of a pixel."""

import pytest

pytest.importorskip("scipy", reason="needs the training extra")
import numpy as np
from scipy import ndimage

from tests.models.light_field.parallax import estimate_disparities


def textured(seed):
    noise = np.random.default_rng(seed).normal(size=(90, 90))
    smooth = ndimage.gaussian_filter(noise, 1.5)
    return 128 + 60 * smooth / smooth.std() / 3


@pytest.mark.parametrize(("axis", "shift"), [(0, 0.3), (1, -1.45), (1, 3.8)])
def test_a_shift_is_found(axis, shift):
    picture = textured(0)
    by = (shift, 0) if axis == 0 else (0, shift)
    found = estimate_disparities(picture, ndimage.shift(picture, by, order=5, mode="mirror"), axis)
    inner = found[1:-1, 1:-1]  # at the edge the shifted picture is made up
    assert np.abs(inner - shift).max() <= 0.02  # cubic splines of what a quintic moved


def test_flat_and_unrelated_patches_have_no_disparity():
    flat = np.full((90, 90), 100.0)
    assert np.isnan(estimate_disparities(flat, flat, 0)).all()
    assert np.isnan(estimate_disparities(textured(1), textured(2), 1)).mean() >= 0.9
