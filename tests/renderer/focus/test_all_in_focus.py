import numpy as np
import pytest
from scipy import ndimage

from ciir.errors import InvalidOption
from ciir.renderer.focus.all_in_focus import _sample, focus_everywhere
from ciir.renderer.focus.disparity import DisparityMap
from ciir.renderer.light_field import LightField
from tests.renderer.focus.test_kernels import keys

NEAR, FAR = 2.0, -0.5
ONES = np.ones((5, 5), np.float32)


def make_views(noise):
    """A textured square before a textured wall, and the disparity of the middle view."""
    random = np.random.default_rng(7)
    wall, square = (
        128 + 300 * ndimage.gaussian_filter(random.standard_normal((80, 90, 3)), (2, 2, 0)) for _ in range(2)
    )
    views = np.empty((5, 5, 60, 70, 3))
    true = np.full((60, 70), FAR, np.float32)
    for v, u in np.ndindex(5, 5):
        views[v, u] = ndimage.shift(wall, (FAR * (2 - v), FAR * (2 - u), 0))[10:70, 10:80]
        top, left = 20 - round(NEAR * (v - 2)), 25 - round(NEAR * (u - 2))
        views[v, u, top : top + 20, left : left + 22] = square[:20, :22]
    true[20:40, 25:47] = NEAR
    views += random.normal(0, noise or 1e-9, views.shape)
    return views.clip(0, 255).round().astype(np.uint8), true


def find_error(picture, truth):
    return np.sqrt(np.square(picture.astype(float) - truth).mean())


def test_noise_falls_and_edges_stay():
    clean = make_views(0)[0][2, 2].astype(float)
    views, true = make_views(10)
    found = DisparityMap((2, 2), true, np.ones_like(true), np.array([FAR, NEAR]), "cameras")
    picture = focus_everywhere(views, found, ONES)
    assert find_error(picture, clean) < 10 / 3  # 25 views: the fifth, and more where views don't reach
    at_edges = ndimage.maximum_filter(true, 7) != ndimage.minimum_filter(true, 7)
    assert find_error(picture[at_edges], clean[at_edges]) < 10 / 2  # where half of the views see something else


def test_a_wrong_disparity_keeps_the_view():
    views, true = make_views(0)
    found = DisparityMap((2, 2), true + 3, np.ones_like(true), np.array([FAR, NEAR]), "cameras")
    assert find_error(focus_everywhere(views, found, ONES), views[2, 2]) < 3


def test_16_bits_of_which_10_are_used_differ_as_8_bits_do():
    """Where the disparity is wrong other views don't count."""
    views, true = make_views(0)
    found = DisparityMap((2, 2), true + 3, np.ones_like(true), np.array([FAR, NEAR]), "cameras")
    picture = focus_everywhere(views.astype(np.uint16) * 4, found, ONES)
    np.testing.assert_allclose(picture / 4, focus_everywhere(views, found, ONES), atol=0.1)


def test_of_a_light_field():
    views, _ = make_views(0)
    light_field = LightField(views, depth_sense="cameras")
    picture = light_field.all_in_focus()
    assert (picture.dtype, picture.shape) == (np.uint8, (60, 70, 3))
    assert find_error(picture, views[2, 2]) < 2
    found = light_field.disparity((0, 4))
    assert find_error(light_field.all_in_focus(found), views[0, 4]) < 3
    middle_alone = light_field.all_in_focus(aperture=0.5)
    assert np.array_equal(middle_alone, views[2, 2])


def test_samples_are_interpolated_where_the_disparity_points():
    random = np.random.default_rng(0)
    view = random.integers(0, 256, (9, 12, 2), dtype=np.uint8)
    up, left = random.uniform(-3, 3, (2, 9, 12)).astype(np.float32)
    samples, is_inside = _sample(view, up, left)
    for y, x in np.ndindex(9, 12):
        row, col = y - up[y, x], x - left[y, x]
        assert is_inside[y, x] == (0 <= row <= 8 and 0 <= col <= 11)
        if 1 <= row <= 7 and 1 <= col <= 10:  # all of the kernel is inside
            expected = sum(keys(row - i) * keys(col - j) * view[i, j].astype(float) for i, j in np.ndindex(9, 12))
            np.testing.assert_allclose(samples[y, x], expected, atol=255e-5)


def test_a_disparity_of_other_pixels():
    views, true = make_views(0)
    found = DisparityMap((2, 2), true[:-1], true[:-1], np.array([FAR, NEAR]), "cameras")
    with pytest.raises(InvalidOption, match="disparity: 59x70 pixels, but the views have 60x70"):
        focus_everywhere(views, found, ONES)


def test_a_disparity_of_another_light_field():
    views, _ = make_views(0)
    light_field = LightField(views, depth_sense="cameras")
    found = light_field.disparity()
    with pytest.raises(InvalidOption, match=r"found: ndarray is not accepted; give what disparity\(\) returns"):
        light_field.all_in_focus(found.disparity)
    with pytest.raises(InvalidOption, match="found: a map of views with the depth sense cameras, not lenses; give the"):
        light_field.with_depth_sense("lenses").all_in_focus(found)
    with pytest.raises(InvalidOption, match="view: 2,2 is not there; v goes from 0 to 1 and u from 0 to 4"):
        light_field[:2].all_in_focus(found)
