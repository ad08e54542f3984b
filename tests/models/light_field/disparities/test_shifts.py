import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from ciir.models.light_field.disparities.shifts import (
    MAXIMUM_DISPARITY,
    NEIGHBOURS,
    SAMPLED_ROWS,
    SHIFT_STEP,
    SHIFT_TILE,
    UNSHIFTED_DISPARITY,
    _blur_tiles,
    _compare_tiles,
    _round_lumas,
    _vote,
    crop_luma,
    crop_with_margin,
    group_by_neighbours,
    list_neighbours,
    select_shifted,
)
from ciir.models.light_field.disparities.shifts import measure_shifts as measure_all_shifts
from tests.models.light_field.disparities.measure import make_lumas, measure_shifts

PICTURE = np.random.default_rng(0).integers(0, 256, (90, 80, 1)).astype(np.uint8)
GRIDS = [((3, 3), (1, 1)), ((1, 3), (0, 1)), ((2, 2), (0, 0)), ((2, 3), (1, 2))]


def shift_picture(disparity, grid, view):
    return {
        (v, u): np.roll(PICTURE, (disparity * (v - view[0]), disparity * (u - view[1])), (0, 1))
        for v in range(grid[0])
        for u in range(grid[1])
    }


@settings(max_examples=30)
@given(st.integers(-MAXIMUM_DISPARITY, MAXIMUM_DISPARITY), st.sampled_from(GRIDS))
def test_a_disparity_is_found_to_a_pixel_beyond_what_networks_search(disparity, case):
    grid, view = case
    found = measure_shifts(shift_picture(disparity, grid, view), view, grid)
    assert found.shape == (12, 10)
    assert not (found % SHIFT_STEP).any()
    inner = found[2:-2, 2:-2]  # content at the edges has left some neighbours
    assert np.abs(inner - disparity).max() <= 1
    assert inner.any() == (abs(disparity) > UNSHIFTED_DISPARITY)


@pytest.mark.parametrize("disparity", [2, 3, 5, 6])
def test_reversed_views_have_the_opposite_shifts(disparity):
    shifts, opposite = (
        measure_shifts(shift_picture(by, (3, 3), (1, 1)), (1, 1), (3, 3)) for by in (disparity, -disparity)
    )
    np.testing.assert_array_equal(opposite[3:-3, 3:-3], -shifts[3:-3, 3:-3])
    assert np.abs(shifts[3:-3, 3:-3]).min() == disparity // SHIFT_STEP * SHIFT_STEP


@pytest.mark.parametrize("disparity", [-1, 0, 1])
def test_small_disparities_are_left_to_the_network_up_to_the_edge(disparity):
    for grid, view in GRIDS:
        assert not measure_shifts(shift_picture(disparity, grid, view), view, grid).any()


def test_views_that_do_not_match_are_not_shifted():
    random = np.random.default_rng(1)
    views = {view: random.integers(0, 256, (90, 80, 3)).astype(np.uint8) for view in np.ndindex(3, 3)}
    assert not measure_shifts(views, (1, 1), (3, 3)).any()


@pytest.mark.parametrize("shape", [(1, 1, 3), (3, 40, 1), (8, 8, 3), (30, 31, 1)])
def test_small_and_flat_views_are_not_shifted(shape):
    shifts = measure_shifts(dict.fromkeys(np.ndindex(3, 3), np.full(shape, 99, np.uint8)), (1, 1), (3, 3))
    assert shifts.shape == (-(-shape[0] // SHIFT_TILE), -(-shape[1] // SHIFT_TILE))
    assert not shifts.any()


def test_few_tiles_are_not_shifted_for_themselves(monkeypatch):
    """A square moves by 6 pixels per view, before one colour."""
    views = {}
    for v, u in np.ndindex(3, 3):
        views[v, u] = np.full((100, 100, 1), 50, np.uint8)
        views[v, u][24 + 6 * v :, 24 + 6 * u :][:40, :40] = PICTURE[:40, :40]
    shifts = measure_shifts(views, (1, 1), (3, 3))
    assert {0, 6} <= set(np.unique(shifts))
    monkeypatch.setattr("ciir.models.light_field.disparities.shifts.MINIMUM_TILES", np.count_nonzero(shifts) + 1)
    assert not measure_shifts(views, (1, 1), (3, 3)).any()


def test_large_views_are_compared_in_strips(monkeypatch):
    views = shift_picture(6, (3, 3), (1, 1))
    whole = measure_shifts(views, (1, 1), (3, 3))
    monkeypatch.setattr("ciir.models.light_field.disparities.shifts.STRIP_VALUES", 1)
    np.testing.assert_array_equal(measure_shifts(views, (1, 1), (3, 3)), whole)


def move(places, by, length):
    return np.where((places + by >= 0) & (places + by < length), places + by, places)


@pytest.mark.parametrize("shape", [(16, 24), (23, 17), (9, 41)])
@pytest.mark.parametrize("count", [1, 4])
def test_tiles_are_compared_as_one_difference_after_the_other_would_be(shape, count):
    height, width = shape
    random = np.random.default_rng(2)
    views, *others = random.integers(0, 256, (5, 2, height, width)).astype(np.uint8)
    neighbours = dict(zip(NEIGHBOURS[-count:], others, strict=False))
    down, across = -(-height // SHIFT_TILE), -(-width // SHIFT_TILE)
    rows = np.minimum(np.arange(SAMPLED_ROWS // 2, down * SHIFT_TILE, SAMPLED_ROWS), height - 1)
    cols = np.minimum(np.arange(across * SHIFT_TILE), width - 1)
    want = np.zeros((2, 5, down, across))
    for number, by in enumerate(range(-2, 3)):
        for (by_row, by_col), other in neighbours.items():
            there = other[:, move(rows, by * by_row, height)[:, None], move(cols, by * by_col, width)]
            difference = np.abs(there.astype(int) - views[:, rows[:, None], cols])
            want[:, number] += difference.reshape(2, down, -1, across, SHIFT_TILE).sum(axis=(2, 4))
    np.testing.assert_array_equal(_compare_tiles(views, neighbours, 2), want)


@pytest.mark.parametrize("values", [1, 10_000, 1 << 30])
def test_a_views_shifts_are_the_same_whichever_others_are_measured(values, monkeypatch):
    grid = (3, 4)
    views = shift_picture(5, grid, (1, 1))
    want = [measure_shifts(views, view, grid) for view in np.ndindex(grid)]
    monkeypatch.setattr("ciir.models.light_field.disparities.shifts.STRIP_VALUES", values)
    got = measure_all_shifts(make_lumas(views), list(np.ndindex(grid)), grid)
    np.testing.assert_array_equal(got, want)
    assert np.any(got)


def test_views_are_grouped_by_the_directions_of_their_neighbours():
    groups = list(group_by_neighbours(list(np.ndindex(2, 4)), (2, 4), 2))
    assert groups == [[(0, 0)], [(0, 1), (0, 2)], [(0, 3)], [(1, 0)], [(1, 1), (1, 2)], [(1, 3)]]
    assert list_neighbours(groups[1], (2, 4)) == {
        (0, 1): [(0, 2), (0, 3)],
        (1, 0): [(1, 1), (1, 2)],
        (0, -1): [(0, 0), (0, 1)],
    }
    assert list_neighbours(groups[2], (2, 4)) == {(1, 0): [(1, 3)], (0, -1): [(0, 2)]}


def test_luma_is_rounded_to_the_nearest_of_256_levels():
    levels = np.arange(1, 255)
    pictures = [(257 * levels + off).astype(np.uint16).reshape(1, -1, 1) for off in (-100, 0, 100)]
    np.testing.assert_array_equal(_round_lumas([crop_luma(picture) for picture in pictures]), [[levels]] * 3)


@pytest.mark.parametrize("shape", [(3, 1, 1), (5, 2, 3), (2, 4, 5)])
def test_differences_of_tiles_are_blurred_as_if_those_at_the_border_went_on(shape):
    cost = np.random.default_rng(3).integers(0, 2**16, shape, np.uint16)
    want = cost.astype(np.int32)
    for axis in (1, 2):
        want = ndimage.correlate1d(want, [1, 2, 1], axis, mode="nearest")
    np.testing.assert_array_equal(_blur_tiles(cost), want)


def test_a_tiles_own_shift_has_two_votes():
    assert _vote(np.array([[0, 3]])).tolist() == [[0, 3]]
    assert _vote(np.array([[0, 3, 0], [0, 3, 0]])).tolist() == [[0, 0, 0], [0, 0, 0]]


def test_each_pixel_of_a_part_has_the_shift_of_its_tile():
    shifts = np.array([[0, 3, 0], [3, 0, 0]])
    got = select_shifted(shifts, 3, (slice(2, 11), slice(6, 20)))
    want = (shifts == 3).repeat(SHIFT_TILE, axis=0).repeat(SHIFT_TILE, axis=1)
    np.testing.assert_array_equal(got, want[2:11, 6:20])


@settings(max_examples=30)
@given(st.integers(1, 60), st.integers(1, 60), st.sampled_from([np.uint8, np.uint16]), st.integers(0, 99))
def test_luma_of_a_colour_is_the_same_to_the_bit_at_every_pixel(height, width, dtype, seed):
    colours = np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, (2, 3), dtype, endpoint=True)
    picture = np.tile(colours[0], (height, width, 1))
    assert np.unique(crop_luma(picture)).size == 1
    picture[::2] = colours[1]
    assert crop_luma(picture)[-1, -1] == crop_luma(picture[-1:, -1:])[0, 0]


@pytest.mark.parametrize("margin", [0, 1, 4, 8])
def test_a_part_is_cropped_with_its_margin_and_edge_pixels_beyond_the_picture(margin):
    picture = np.arange(35, dtype=np.uint8).reshape(5, 7, 1)
    got = crop_with_margin(picture, (slice(1, 4), slice(3, 7)), margin)
    wide = np.pad(picture, ((8, 8), (8, 8), (0, 0)), mode="edge")
    np.testing.assert_array_equal(got, wide[9 - margin : 12 + margin, 11 - margin : 15 + margin])
