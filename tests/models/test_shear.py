import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.shear import MOST, WITHIN, whole_disparity

PICTURE = np.random.default_rng(0).random((90, 80), dtype=np.float32)
OFFSETS = [(0, 1), (1, 0), (0, -1), (-1, 0)]


def moved(disparity, offsets):
    return {at: np.roll(PICTURE, (disparity * at[0], disparity * at[1]), (0, 1)) for at in offsets}


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(-MOST, MOST), st.lists(st.sampled_from(OFFSETS), min_size=1, unique=True))
def test_a_whole_disparity_is_found_where_it_is_more_than_a_network_looks_for(disparity, offsets):
    found = whole_disparity(PICTURE, moved(disparity, offsets))
    assert found == (disparity if abs(disparity) > WITHIN else 0)


def test_views_that_do_not_match_are_not_moved():
    other = np.random.default_rng(1).random((90, 80), dtype=np.float32)
    assert whole_disparity(PICTURE, dict.fromkeys(OFFSETS, other)) == 0


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (8, 8)])
def test_small_and_flat_views_are_not_moved(shape):
    flat = np.full(shape, 0.5, np.float32)
    assert whole_disparity(flat, dict.fromkeys(OFFSETS, flat)) == 0
