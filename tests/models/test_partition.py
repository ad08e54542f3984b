"""Which rectangles of a picture are run, from cells whose errors are known."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from models.cells import CELL
from models.partition import windows


@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.integers(1, 150), st.integers(1, 150), st.integers(0, 9), st.floats(0.001, 300), st.integers(0, 9))
def test_windows_keep_the_budget_and_see_around(height, width, around, budget, seed):
    random = np.random.default_rng(seed)
    shape = (-(-height // CELL), -(-width // CELL))
    cells = random.exponential(1, shape) * (random.random(shape) < 0.3)
    if seed == 0:
        cells[0, 0] = np.inf  # beyond what was learnt
    found = windows(cells, height, width, around, budget)
    if found is None:
        return
    by_network = np.zeros((height, width), int)
    for window in found:
        (top, bottom), (left, right) = window.rows, window.cols
        by_network[top:bottom, left:right] += 1
        assert window.kept == (bottom - top) * (right - left) > 0
        assert max(0, top - around) >= window.top >= 0
        assert max(0, left - around) >= window.left >= 0
        assert min(height, bottom + around) <= window.top + window.height <= height
        assert min(width, right + around) <= window.left + window.width <= width
    assert by_network.max(initial=0) <= 1
    skipped = by_network[::CELL, ::CELL] == 0
    assert cells[skipped].sum() <= budget * (1 + 1e-9)


def test_a_price_finds_most_of_what_can_be_skipped():
    """One corner holds all of the error: what is computed is little more than it."""
    cells = np.full((32, 32), 0.01)
    cells[:8, :8] = 50
    (window,) = windows(cells, 256, 256, 8, budget=20)
    assert (window.rows, window.cols) == ((0, 64), (0, 64))


def test_nothing_is_run_where_all_is_below_the_bound():
    assert windows(np.full((8, 8), 0.1), 64, 64, 8, budget=7) == []


def test_a_picture_full_of_detail_goes_whole():
    assert windows(np.full((32, 32), 50.0), 256, 256, 8, budget=20) is None
