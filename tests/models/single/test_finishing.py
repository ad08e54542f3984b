"""Pictures that a network harms become means with bicubic interpolation."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from ciir.models.single import finishing
from ciir.models.single.finishing import MOST, average_misfit
from ciir.models.single.interpolation import Bicubic
from ciir.models.single.pixels import upscale_pixels

SIDE = 160


def make_truth():
    """Smooth noise with edges, `(SIDE, SIDE, 3)`."""
    rng = np.random.default_rng(0)
    smooth = gaussian_filter(rng.standard_normal((SIDE, SIDE, 3)), (2, 2, 0))
    return np.clip(128 + 300 * smooth + 40 * np.sign(gaussian_filter(smooth, (3, 3, 0))), 0, 255).astype(np.uint8)


def downscale(picture):
    return np.asarray(Image.fromarray(picture).resize((SIDE // 2, SIDE // 2), Image.Resampling.BICUBIC))


def interpolate(small):
    return upscale_pixels(Bicubic(2), small[np.newaxis], keeps_fractions=True)[0] / (
        257 if small.dtype == np.uint8 else 1
    )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_picture_that_fits_stays_as_it_is(dtype):
    factor = 257 if dtype == np.uint16 else 1
    truth = make_truth()
    large, small = (picture.astype(dtype) * dtype(factor) for picture in (truth, downscale(truth)))
    before = large.copy()
    assert average_misfit(large, small) == 0
    np.testing.assert_array_equal(large, before)


@pytest.mark.parametrize("rows", [7, 64, 1000])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_one_that_does_not_becomes_the_mean_with_interpolation(monkeypatch, rows, channels, dtype):
    monkeypatch.setattr(finishing, "STRIP_ROWS", rows)
    rng = np.random.default_rng(1)
    small = rng.integers(0, np.iinfo(dtype).max, (40, 30, channels), dtype, endpoint=True)
    large = rng.integers(0, np.iinfo(dtype).max, (80, 60, channels), dtype, endpoint=True)
    wanted = (1 - MOST) * large + MOST * interpolate(small)
    assert average_misfit(large, small) == MOST
    assert np.abs(large - wanted).max() <= 0.51  # rounded to nearest, from float32


def test_the_share_grows_with_the_errors_of_a_jpeg():
    truth = make_truth()
    shares = []
    for quality in (100, 85, 30):
        file = io.BytesIO()
        Image.fromarray(downscale(truth)).save(file, "JPEG", quality=quality)
        shares.append(average_misfit(truth.copy(), np.asarray(Image.open(file))))
    assert 0 == shares[0] < shares[1] < shares[2] <= MOST


@pytest.mark.parametrize(("height", "width"), [(1, 1), (4, 90), (2, 3)])
def test_pictures_too_small_to_compare_have_the_largest_share(height, width):
    small = np.random.default_rng(2).integers(0, 256, (height, width, 3), np.uint8)
    assert average_misfit(np.zeros((2 * height, 2 * width, 3), np.uint8), small) == MOST


def test_a_flat_picture_fits():
    assert average_misfit(np.full((40, 40, 3), 90, np.uint8), np.full((20, 20, 3), 90, np.uint8)) == 0


def test_hidden_colours_do_not_count():
    truth = make_truth()
    small = downscale(truth)
    alpha = np.zeros((SIDE // 2, SIDE // 2, 1), np.uint8)
    alpha[:, 20:] = 255
    hidden = small * (alpha > 0) + np.random.default_rng(3).integers(0, 256, small.shape, np.uint8) * (alpha == 0)
    large = np.concatenate([truth, alpha.repeat(2, 0).repeat(2, 1)], axis=2) * (alpha > 0).repeat(2, 0).repeat(2, 1)
    assert average_misfit(large, np.concatenate([hidden, alpha], axis=2).astype(np.uint8)) < 0.1


def test_levels_stay_within_the_bits_of_the_camera():
    small = np.random.default_rng(4).choice(
        np.array([0, 4095], np.uint16), (40, 40, 3)
    )  # bicubic interpolation exceeds 4095
    large = np.full((80, 80, 3), 4095, np.uint16)
    assert average_misfit(large, small) == MOST
    assert large.max() == 4095
