import numpy as np
import pytest

from ciir.renderer.displays.interpolation import (
    REST,
    WINDOW,
    _interpolate,
    find_disparities,
    interpolate_views,
    shift_rows,
    weigh_neighbours,
)
from tests.support.light_fields import make_views


def psnr(one, other):
    return 10 * np.log10(255**2 / max(np.mean((one.astype(float) - other) ** 2), 1e-9))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_views_between_views_follow_the_disparity(dtype):
    truth = make_views((1, 9), disparities=(-1, 2), dtype=dtype)[0]  # from one to the next: -2 and 4 where half is left
    found = interpolate_views(truth[::2], 9)
    assert np.array_equal(found[::2], truth[::2])
    levels = 257 if dtype == np.uint16 else 1
    inside = (slice(None), slice(8, -8))  # what leaves a view is not known
    rows = np.r_[0:40, 56:96]  # nor what is beside an edge in depth
    for index in (1, 3, 5, 7):
        blended = (truth[index - 1].astype(float) + truth[index + 1]) / 2
        assert psnr(found[index][rows][inside] / levels, truth[index][rows][inside] / levels) > 45
        assert psnr(blended[rows][inside] / levels, truth[index][rows][inside] / levels) < 25


@pytest.mark.parametrize("disparities", [(0, 0), (-1, 3), (8, -8)])
def test_disparities_are_found_in_the_sense_of_nearness(disparities):
    views = make_views((1, 3), disparities=disparities, side=128)[0]  # content moves by these to the right
    assert find_disparities(views) == (-max(disparities), -min(disparities))


def test_any_number_of_views_reaches_from_the_first_to_the_last():
    truth = make_views((1, 5), disparities=(1, 1))[0]
    found = interpolate_views(truth, 12)
    assert len(found) == 12
    assert np.array_equal(found[0], truth[0])
    assert np.array_equal(found[-1], truth[-1])


def test_fewer_views_than_there_are_are_taken_at_equal_steps():
    truth = make_views((1, 9), disparities=(1, 1))[0]
    assert np.array_equal(interpolate_views(truth, 5), truth[::2])


@pytest.mark.parametrize("size", [(1, 1), (2, 2), (5, 4)])
def test_the_smallest_views_are_interpolated(size):
    assert interpolate_views(np.zeros((2, *size, 3), np.uint8), 3).shape == (3, *size, 3)


def test_the_disparity_of_each_pixel_is_that_of_the_cheapest_box():
    """A slow sweep, pixel by pixel, with costs repeated beyond the borders. In noise all cost much the same."""
    left, right = np.random.default_rng(4).integers(0, 256, (2, 20, 24, 3), dtype=np.uint8)
    searched, fraction = range(-2, 3), 0.25
    costs = np.empty((len(searched), *left.shape[:2]))
    for index, disparity in enumerate(searched):
        moved = (fraction * disparity, left), ((fraction - 1) * disparity, right)
        first, second = (shift_rows(view.astype(np.float32), shift) for shift, view in moved)
        cost = np.pad(np.abs(first - second).mean(axis=2), WINDOW // 2, "edge")
        for y, x in np.ndindex(left.shape[:2]):
            costs[index, y, x] = cost[y : y + WINDOW, x : x + WINDOW].mean() + REST * abs(disparity)
    _, found = _interpolate(left, right, fraction, searched)
    np.testing.assert_array_equal(found, costs.argmin(axis=0) + searched[0])


def test_one_view_stands_for_all():
    views = np.zeros((1, 4, 5, 3), np.uint8)
    assert interpolate_views(views, 7).shape == (7, 4, 5, 3)


def test_neighbours_are_weighed_by_distance_and_end_at_the_border():
    (low, of_low), (high, of_high) = weigh_neighbours(np.array([-3.0, 0.25, 3.0, 9.0]), 4)
    assert np.allclose(low * of_low + high * of_high, [0, 0.25, 3, 3])
    assert np.allclose(of_low + of_high, 1)
    assert high.max() == 3
    (low, _), (high, _) = weigh_neighbours(np.array([0.0, 5.0]), 1)
    assert low.tolist() == high.tolist() == [0, 0]
