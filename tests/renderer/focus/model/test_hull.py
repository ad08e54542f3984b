import numpy as np
import pytest

from ciir.renderer.focus.model.hull import explains_views, find_share, find_shown, lies_in_hull
from ciir.renderer.focus.model.model import Model
from ciir.renderer.lens_array import LensArray
from ciir.renderer.light_field import LightField

ARRAY = LensArray(8, 8, 3, 3, pitch=1.0, delta=0.5)


def make_field(disparity):
    """A white square of 4x4 pixels that moves to the left and up by `disparity` from view to view."""
    views = np.zeros((3, 3, 8, 8, 3), np.uint8)
    for v, u in np.ndindex(3, 3):
        y, x = (2 - disparity * (n - 1) for n in (v, u))
        views[v, u, y : y + 4, x : x + 4] = 255
    return LightField(views, "lenses")


def make_square(disparity, low, high):
    """In rows and columns `low` to `high` of the centre view, of two triangles."""
    left, right, z = low - 3.5, high - 3.5, -disparity / ARRAY.delta
    vertices = np.array([[left, -left, z], [right, -left, z], [left, -right, z], [right, -right, z]])
    return Model(vertices, np.full((4, 3), 255, np.uint8), np.array([[0, 2, 1], [1, 2, 3]], np.int32), ARRAY)


def test_black_inside_a_scene_is_no_background():
    field = make_field(0)
    field.views[1, 1, 3, 3] = 0
    shown = find_shown(field)
    assert shown[1, 1, 2:6, 2:6].all()
    assert shown.sum() == 9 * 16


@pytest.mark.parametrize("disparity", [-1, 0, 1])
def test_where_a_square_is_no_view_sees_background_behind_it(disparity):
    shown = find_shown(make_field(disparity))
    share = find_share(shown, (1, 1), disparity)
    assert not share[2:6, 2:6].any()
    assert share[:2].all()
    assert find_share(shown, (1, 1), disparity + 1)[2, 2] > 0.3  # 5 of 9 views see it beside the square
    assert not find_share(shown, (1, 1), 99.0)[2:6, 2:6].any()  # in no other picture


@pytest.mark.parametrize("disparity", [-1, 0, 1])
def test_points_of_a_square_lie_in_its_hull(disparity):
    shown = find_shown(make_field(disparity)).astype(np.float32)
    points = make_square(disparity, 2, 5).vertices
    assert lies_in_hull(points, shown, ARRAY).all()
    assert not lies_in_hull(points * [1, 1, 1] + [0, 0, 2], shown, ARRAY).any()
    assert not lies_in_hull(points * [2, 2, 1], shown, ARRAY).any()


def test_pixels_that_are_barely_covered_are_no_part_of_the_hull():
    coverage = np.zeros((3, 3, 8, 8), np.float32)
    coverage[..., 2:6, 2:6] = 1
    coverage[..., 1, 2:6] = 0.2
    points = make_square(0, 1, 5).vertices * [0.5, 1, 1]  # in rows 1 and 5
    assert lies_in_hull(points, coverage, ARRAY).tolist() == [False, False, True, True]


def test_triangles_stay_where_views_show_their_colour():
    field = make_field(1)
    shown = find_shown(field)
    assert explains_views(make_square(1, 2, 5).scene(), field, shown, ARRAY).all()
    assert not explains_views(make_square(1, 0, 1).scene(), field, shown, ARRAY).any()
    dark = make_field(1)
    dark.views[:] //= 4  # white is farther from it than black
    assert not explains_views(make_square(1, 2, 5).scene(), dark, shown, ARRAY).any()
