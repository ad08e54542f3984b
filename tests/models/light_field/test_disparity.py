import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models.light_field.disparity import (
    MAXIMUM_DISPARITY,
    UNSHIFTED_DISPARITY,
    crop_luma,
    crop_with_margin,
    estimate_disparity,
)

PICTURE = np.random.default_rng(0).random((90, 80), dtype=np.float32)
OFFSETS = [(0, 1), (1, 0), (0, -1), (-1, 0)]


def shift_picture(disparity, offsets):
    return {at: np.roll(PICTURE, (disparity * at[0], disparity * at[1]), (0, 1)) for at in offsets}


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(-MAXIMUM_DISPARITY, MAXIMUM_DISPARITY), st.lists(st.sampled_from(OFFSETS), min_size=1, unique=True))
def test_a_whole_disparity_is_found_beyond_what_networks_search(disparity, offsets):
    found = estimate_disparity(PICTURE, shift_picture(disparity, offsets))
    assert found == (disparity if abs(disparity) > UNSHIFTED_DISPARITY else 0)


def test_views_that_do_not_match_are_not_shifted():
    other = np.random.default_rng(1).random((90, 80), dtype=np.float32)
    assert estimate_disparity(PICTURE, dict.fromkeys(OFFSETS, other)) == 0


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (8, 8)])
def test_small_and_flat_views_are_not_shifted(shape):
    flat = np.full(shape, 0.5, np.float32)
    assert estimate_disparity(flat, dict.fromkeys(OFFSETS, flat)) == 0


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(1, 60), st.integers(1, 60), st.sampled_from([np.uint8, np.uint16]), st.integers(0, 99))
def test_luma_of_a_colour_is_the_same_to_the_bit_at_every_pixel(height, width, dtype, seed):
    colours = np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, (2, 3), dtype, endpoint=True)
    picture = np.tile(colours[0], (height, width, 1))
    assert np.unique(crop_luma(picture)).size == 1
    picture[::2] = colours[1]
    assert crop_luma(picture)[-1, -1] == crop_luma(picture[-1:, -1:])[0, 0]


@pytest.mark.parametrize("shift", [-2, 0, 1])
def test_a_part_is_cropped_with_its_margin_and_edge_pixels_beyond_the_picture(shift):
    picture = np.arange(35, dtype=np.uint8).reshape(5, 7, 1)
    got = crop_with_margin(picture, (slice(1, 4), slice(3, 7)), shift)
    wide = np.pad(picture, ((4, 4), (4, 4), (0, 0)), mode="edge")
    margin = 2 * abs(shift)
    np.testing.assert_array_equal(got, wide[5 - margin : 8 + margin, 7 - margin : 11 + margin])
