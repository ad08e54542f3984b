"""Views that were made small with an antialiasing filter are found, and averaged."""

import numpy as np
import pytest
from PIL import Image

from ciir.models.light_field import antialiasing
from ciir.models.light_field.antialiasing import MOST, SURROUNDED, WHOLE_ROWS
from ciir.models.light_field.views import upscale_views


def find_fallback_share(large, small, *, is_surrounded=False):
    return antialiasing.find_fallback_share(large, small, is_surrounded=is_surrounded)


def make_fine(height, width, channels=3, dtype=np.uint8):
    """A picture of twice that size with detail up to its finest."""
    values = np.random.default_rng(0).random((2 * height, 2 * width, channels))
    return (values * np.iinfo(dtype).max).astype(dtype)


def filter_down(fine):
    """Half as large, by bicubic interpolation with antialiasing."""
    size = (fine.shape[1] // 2, fine.shape[0] // 2)
    planes = [Image.fromarray(plane.astype(np.float32)) for plane in np.moveaxis(fine, 2, 0)]
    small = np.stack([plane.resize(size, Image.Resampling.BICUBIC) for plane in planes], axis=2)
    return np.rint(small).clip(0, np.iinfo(fine.dtype).max).astype(fine.dtype)


def average_down(fine):
    height, width, channels = fine.shape
    means = fine.reshape(height // 2, 2, width // 2, 2, channels).mean(axis=(1, 3))
    return np.rint(means).astype(fine.dtype)


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (3, np.uint8), (3, np.uint16)])
@pytest.mark.parametrize("height", [9, WHOLE_ROWS, WHOLE_ROWS + 1, 300])
def test_what_was_filtered_is_told_from_means_and_samples(height, channels, dtype):
    fine = make_fine(height, 40, channels, dtype)
    assert find_fallback_share(fine, filter_down(fine)) == MOST
    assert find_fallback_share(fine, filter_down(fine), is_surrounded=True) == SURROUNDED
    assert find_fallback_share(fine, average_down(fine)) == 0


def test_samples_are_not_taken_for_filtered():
    finer = make_fine(100, 80)
    for axis in (0, 1):
        finer = ((finer.astype(np.uint16) + np.roll(finer, 1, axis)) // 2).astype(np.uint8)
    small = average_down(finer[1:-1, 1:-1])[::2, ::2]  # the middle of each 4x4 samples
    assert find_fallback_share(average_down(finer), small) == 0


def test_between_both_the_share_falls():
    fine = make_fine(60, 40)
    ends = filter_down(fine).astype(float), average_down(fine).astype(float)
    mixed = [np.rint((1 - part) * ends[0] + part * ends[1]).astype(np.uint8) for part in np.linspace(0, 1, 21)]
    shares = [find_fallback_share(fine, small) for small in mixed]
    assert shares == sorted(shares, reverse=True)
    assert any(0 < share < MOST for share in shares)


@pytest.mark.parametrize("shape", [(2, 2), (4, 30), (30, 4), (1, 1)])
def test_a_view_that_is_all_border_is_not_averaged(shape):
    fine = make_fine(*shape)
    assert find_fallback_share(fine, filter_down(fine)) == 0


def test_a_flat_view_is_not_averaged():
    assert find_fallback_share(np.full((80, 60, 3), 77, np.uint8), np.full((40, 30, 3), 77, np.uint8)) == 0


@pytest.mark.parametrize("height", [WHOLE_ROWS, 4 * WHOLE_ROWS])
def test_both_halves_of_a_view_count(height):
    fine = make_fine(height, 40)
    for half in (slice(height // 2), slice(height // 2, None)):
        small = filter_down(fine)
        small[half] = average_down(fine)[half]
        assert 0 < find_fallback_share(fine, small) < MOST


class Making:
    """A stand-in for a light-field network, which makes one picture of every view, and is certain of it."""

    scale, radius, threads = 2, 2, 1

    def __init__(self, fine):
        self.planes = np.moveaxis(fine, 2, 0)[np.newaxis].astype(np.float32) / 255

    def __call__(self, image, around, rows, cols, *, cores=None):
        return self.planes.repeat(len(image), axis=0), np.full_like(image[:, :1], 0.3)


class Black:
    """A stand-in for a single-picture network."""

    name, scale, radius = "black", 2, 0

    def __call__(self, images):
        return np.zeros_like(images).repeat(2, axis=2).repeat(2, axis=3)


def test_filtered_views_are_means_of_both_networks():
    fine = make_fine(40, 30)
    every = [(v, u) for v in range(5) for u in range(6)]
    for small, is_filtered in ((filter_down(fine), True), (average_down(fine), False)):
        for averages in (True, False):
            views = dict.fromkeys(every, small)
            made, used = upscale_views(Making(fine), Black(), views, every, (5, 6), averages=averages)
            is_mean = is_filtered and averages
            assert used == (0, is_mean)
            for picture, view in zip(made, every, strict=True):
                share = (SURROUNDED if view in {(2, 2), (2, 3)} else MOST) if is_mean else 0
                np.testing.assert_allclose(picture, fine * (1 - share), atol=1)  # rounded twice
