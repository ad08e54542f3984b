import numpy as np
import pytest

from ciir.renderer.focus.model.patch import make_patch


def find_area(patch):
    """The area of the triangles in pixels, which is negative where they are clockwise on the screen."""
    x, y = patch.x[patch.faces], patch.y[patch.faces]
    return ((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])) / 2


def test_a_plane_stays_a_plane_and_covers_its_pixels():
    y, x = np.mgrid[:5, :7]
    patch = make_patch(np.full((5, 7, 3), 90), 0.1 * x + 0.05 * y, np.ones((5, 7), bool), 0.2)
    inside = (patch.x > 0) & (patch.x < 6) & (patch.y > 0) & (patch.y < 4)
    assert patch.disparity[inside] == pytest.approx(0.1 * patch.x[inside] + 0.05 * patch.y[inside])
    assert -find_area(patch) == pytest.approx(np.full(5 * 7 * 4, 0.25))  # counter-clockwise: rows count downwards
    assert len(patch.x) == 5 * 7 + 6 * 8  # pixels share their corners
    assert (patch.colors == 90).all()


def test_a_jump_is_cut_and_nothing_of_one_side_is_on_the_other():
    picture = np.zeros((4, 6, 3))
    picture[:, 3:] = 200
    disparity = np.where(np.arange(6) < 3, 0.0, 1.0) * np.ones((4, 1))
    patch = make_patch(picture, disparity, np.ones((4, 6), bool), 0.5)
    assert set(np.unique(patch.disparity)) == {0.0, 1.0}
    assert (patch.colors[:, 0] == np.where(patch.disparity == 1, 200, 0)).all()
    assert np.ptp(patch.disparity[patch.faces], axis=1).max() == 0
    joined = make_patch(picture, disparity, np.ones((4, 6), bool), 1.0)
    assert np.ptp(joined.disparity[joined.faces], axis=1).max() == 0.5


def test_pixels_that_are_not_used_count_for_nothing():
    is_used = np.zeros((3, 3), bool)
    is_used[1, 1] = True
    patch = make_patch(np.arange(27.0).reshape(3, 3, 3), np.arange(9.0).reshape(3, 3), is_used, 100)
    assert (len(patch.x), len(patch.faces)) == (5, 4)
    assert (patch.disparity == 4).all()
    assert (patch.colors == [12, 13, 14]).all()
    assert sorted(zip(patch.y, patch.x, strict=True)) == [(0.5, 0.5), (0.5, 1.5), (1, 1), (1.5, 0.5), (1.5, 1.5)]
