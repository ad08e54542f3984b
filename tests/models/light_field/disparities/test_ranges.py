"""Known disparities and misalignments are found, and not those of noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import rotate

from ciir.models.light_field.disparities.ranges import MOST_TILES, UNKNOWN, measure_ranges
from ciir.models.light_field.disparities.shifts import SHIFT_STEP, make_no_shifts
from ciir.models.light_field.planes import STEP
from tests.models.light_field.disparities.measure import make_lumas, measure_misalignment, measure_range, measure_shifts

SIDE = 80
FREQUENCIES = np.random.default_rng(0).normal(size=(120, 2)) * 0.9
"""Radians a pixel, of waves that add up to a texture: it can be shifted by any part of a pixel."""
PHASES = np.random.default_rng(1).uniform(0, 2 * np.pi, 120)
GRIDS = [((3, 3), (1, 1)), ((3, 3), (0, 2)), ((5, 4), (2, 0))]


def make_texture(down, right, shape=(SIDE, SIDE)):
    """The texture moved by pixels `down` and to the `right`, in levels about 128."""
    rows, cols = (np.arange(length) for length in shape)
    along_y = np.exp(1j * np.outer(rows - down, FREQUENCIES[:, 0]))
    along_x = np.exp(1j * (np.outer(cols - right, FREQUENCIES[:, 1]) + PHASES))
    waves = (along_y @ along_x.T).real  # each wave is the cosine of the sum of both angles
    return 128 + waves * 40 / np.sqrt(len(PHASES) / 2)


def make_views(grid, view, layers, *, noise=0.0, shape=(SIDE, SIDE), channels=3, moved=None):
    """Views of which equal parts from the left to the right have the disparities `layers`. `moved`: pixels down and to
    the right by which some views are moved besides."""
    random, views = np.random.default_rng(2), {}
    for v, u in np.ndindex(grid):
        down, right = (moved or {}).get((v, u), (0, 0))
        parts = [make_texture(by * (v - view[0]) + down, by * (u - view[1]) + right, shape) for by in layers]
        edges = np.linspace(0, shape[1], len(layers) + 1).astype(int)
        picture = np.concatenate([part[:, a:b] for part, a, b in zip(parts, edges, edges[1:], strict=False)], axis=1)
        picture = picture[..., None] + random.normal(0, noise, (*shape, channels))
        views[v, u] = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return views


@settings(max_examples=40, deadline=None)
@given(st.floats(-1.4, 1.4), st.sampled_from(GRIDS), st.sampled_from([0.0, 4.0]))
def test_a_disparity_is_found_to_a_part_of_a_pixel(disparity, case, noise):
    grid, view = case
    views = make_views(grid, view, [disparity], noise=noise)
    low, high = measure_range(views, view, grid, make_no_shifts(SIDE, SIDE))
    assert low <= disparity <= high
    assert high - low <= (0.5 if not noise else 0.75)
    assert (low / STEP, high / STEP) == (round(low / STEP), round(high / STEP))


@pytest.mark.parametrize("layers", [(-0.9, 0.3), (0.1, 0.2, 0.7), (-1.2, 1.2)])
def test_the_range_spans_all_layers(layers):
    views = make_views((3, 3), (1, 1), layers, shape=(SIDE, 144))
    low, high = measure_range(views, (1, 1), (3, 3), make_no_shifts(SIDE, 144))
    assert min(layers) - 0.4 <= low <= min(layers)
    assert max(layers) <= high <= max(layers) + 0.4


@pytest.mark.parametrize("axis", [0, 1])
def test_a_thin_band_of_a_large_view_is_seen(axis):
    """In views of 640x640 pixels, the number of whose tiles is a multiple of the number that is compared."""
    shape = (640, 640)
    views, near = (make_views((3, 3), (1, 1), [disparity], shape=shape) for disparity in (0.1, 0.8))
    band = [slice(None), slice(None)]
    band[axis] = slice(260, 340)
    for at, view in views.items():
        view[tuple(band)] = near[at][tuple(band)]
    assert measure_range(views, (1, 1), (3, 3), make_no_shifts(*shape)).highest >= 0.8


@pytest.mark.parametrize("disparity", [-6.3, 2.8, 9.4])
def test_the_rest_that_shifts_leave_is_measured(disparity):
    views = make_views((3, 3), (1, 1), [disparity], shape=(128, 128))
    shifts = measure_shifts(views, (1, 1), (3, 3))
    shift = np.median(shifts)
    assert abs(disparity - shift) <= SHIFT_STEP / 2 + 0.5  # a whole disparity is rounded, and so is its shift
    low, high = measure_range(views, (1, 1), (3, 3), shifts)
    assert low <= disparity - shift <= high
    assert high - low < 3


def test_flat_small_unrelated_and_single_views_have_no_known_range():
    random = np.random.default_rng(3)
    flat = dict.fromkeys(np.ndindex(3, 3), np.full((SIDE, SIDE, 3), 90, np.uint8))
    small = make_views((3, 3), (1, 1), [0.5], shape=(15, 15))
    noise = {view: random.integers(0, 256, (SIDE, SIDE, 3), np.uint8) for view in np.ndindex(3, 3)}
    for views in (flat, small, noise):
        assert measure_range(views, (1, 1), (3, 3)) == UNKNOWN
    assert measure_range(make_views((1, 1), (0, 0), [0.5]), (0, 0), (1, 1)) == UNKNOWN


def test_grey_and_16_bits_are_measured_alike():
    views = make_views((3, 3), (1, 1), [0.4], channels=1)
    want = measure_range(views, (1, 1), (3, 3))
    assert measure_range({view: picture.repeat(3, axis=2) for view, picture in views.items()}, (1, 1), (3, 3)) == want
    assert measure_range({view: picture * np.uint16(257) for view, picture in views.items()}, (1, 1), (3, 3)) == want


def test_some_tiles_of_a_large_view_are_enough(monkeypatch):
    views = make_views((3, 3), (1, 1), [-0.3, 0.6], shape=(200, 200))
    assert views[1, 1].size // 3 // 64 > MOST_TILES
    low, high = measure_range(views, (1, 1), (3, 3))
    monkeypatch.setattr("ciir.models.light_field.disparities.ranges.MOST_TILES", 10**6)
    assert measure_range(views, (1, 1), (3, 3)) == pytest.approx((low, high), abs=0.13)


def test_a_views_range_is_the_same_whichever_others_are_measured(monkeypatch):
    """In a grid whose views have other neighbours, one of them noise, a few at a time and all at once.

    Their lower parts move by 3.9 pixels, which in every second view are shifted by 3.
    """
    grid = (3, 4)
    wanted = list(np.ndindex(grid))
    views, low = (make_views(grid, (1, 1), layers, noise=2.0, shape=(48, 60)) for layers in ([-0.8, 0.3], [3.9]))
    for view in wanted:
        views[view][24:] = low[view][24:]
    views[0, 0] = np.random.default_rng(4).integers(0, 256, (48, 60, 3), np.uint8)
    lumas = make_lumas(views)
    shifts = [make_no_shifts(48, 60) for _ in wanted]
    for own in shifts[1::2]:
        own[3:] = 3
    together, misalignments = measure_ranges(lumas, wanted, grid, shifts)
    assert together == [measure_range(views, view, grid, own) for view, own in zip(wanted, shifts, strict=True)]
    assert together[wanted.index((1, 1))].highest > 0.9 > together[wanted.index((1, 2))].highest
    monkeypatch.setattr("ciir.models.light_field.disparities.ranges.TILES_AT_ONCE", 1)
    assert measure_ranges(lumas, wanted, grid, shifts) == (together, misalignments)


@pytest.mark.parametrize("noise", [0.0, 8.0])
@pytest.mark.parametrize("layers", [(0.3,), (-0.9, 0.4), (3.8, 5.2)])
@pytest.mark.parametrize(("grid", "view"), GRIDS)
def test_views_that_lie_where_they_should_are_aligned(grid, view, layers, noise):
    views = make_views(grid, view, layers, noise=noise, shape=(SIDE, 144))
    assert measure_misalignment(views, view, grid) < 0.09


@pytest.mark.parametrize("noise", [0.0, 5.0])
@pytest.mark.parametrize("disparity", [-0.4, 1.2])
def test_the_distance_of_a_moved_view_is_found(disparity, noise):
    """All its neighbours are as far away, and each of them has one neighbour of three that is."""
    views = make_views((3, 3), (1, 1), [disparity], noise=noise, moved={(1, 1): (0.3, -0.4)})
    assert measure_misalignment(views, (1, 1), (3, 3)) == pytest.approx(0.5, abs=0.1)
    assert 0.08 < measure_misalignment(views, (0, 1), (3, 3)) < 0.25
    assert measure_misalignment(views, (0, 0), (3, 3)) < 0.05


@pytest.mark.parametrize("degrees", [0.5, -0.8])
def test_the_distance_of_a_turned_view_is_found(degrees):
    """Its halves are moved in opposite directions, so that the median of all tiles is about 0."""
    side = 128
    views = make_views((3, 3), (1, 1), [0.3], shape=(side, side))
    views[1, 1] = rotate(views[1, 1], degrees, reshape=False, mode="mirror")
    root_mean_square = np.deg2rad(abs(degrees)) * side / 6**0.5
    assert measure_misalignment(views, (1, 1), (3, 3)) == pytest.approx(root_mean_square, rel=0.15)
    assert measure_misalignment(views, (0, 0), (3, 3)) < 0.05


def test_quadrants_with_few_textured_tiles_do_not_count():
    views = make_views((3, 3), (1, 1), [0.3], shape=(SIDE, SIDE))
    views[1, 1] = rotate(views[1, 1], 1, reshape=False, mode="mirror")
    for view in views.values():
        view[:24] = view[-24:] = 128
    assert measure_misalignment(views, (1, 1), (3, 3)) < 0.15


def test_neighbours_at_random_places_are_misaligned_and_unrelated_and_flat_ones_are_not():
    random = np.random.default_rng(5)
    places = {view: tuple(random.uniform(-0.6, 0.6, 2)) for view in np.ndindex(3, 3)}
    assert measure_misalignment(make_views((3, 3), (1, 1), [0.5], moved=places), (1, 1), (3, 3)) > 0.3
    noise = {view: random.integers(0, 256, (160, 160, 3), np.uint8) for view in np.ndindex(3, 3)}
    assert measure_misalignment(noise, (1, 1), (3, 3)) < 0.15
    flat = dict.fromkeys(np.ndindex(3, 3), np.full((SIDE, SIDE, 3), 90, np.uint8))
    assert measure_misalignment(flat, (1, 1), (3, 3)) == 0
