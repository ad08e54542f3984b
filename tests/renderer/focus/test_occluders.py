import numpy as np
import pytest
from scipy import ndimage

from ciir.errors import InvalidOption
from ciir.renderer.focus import occluders
from ciir.renderer.focus.occluders import _line_up, make_planes
from ciir.renderer.focus.planes import refocus

ONES = np.ones((7, 7), np.float32)
WALL, FENCE = 0.5, 2.5


def make_scene(noise=0.0):
    """A textured wall behind a fence of one colour that hides a third of it, and the wall as the middle sees it."""
    random = np.random.default_rng(5)
    wall = ndimage.gaussian_filter(random.standard_normal((100, 110, 3)), (2, 2, 0))
    wall = 128 + 100 * wall / np.abs(wall).max()
    views = np.empty((7, 7, 60, 70, 3))
    y, x = np.mgrid[:60, :70]
    for v, u in np.ndindex(7, 7):
        views[v, u] = ndimage.shift(wall, (WALL * (3 - v), WALL * (3 - u), 0))[20:80, 20:90]
        is_fence = ((x + FENCE * (u - 3)) % 18 < 3) | ((y + FENCE * (v - 3)) % 22 < 3)
        views[v, u][is_fence] = (20, 60, 10)
    views += random.normal(0, noise or 1e-9, views.shape)
    return views.clip(0, 255).round().astype(np.uint8), wall[20:80, 20:90]


def compute_psnr(picture, truth):
    return 10 * np.log10(255**2 / np.square(picture - truth).mean())


@pytest.mark.parametrize(("noise", "least"), [(0, 45), (10, 33)])
def test_a_wall_behind_a_fence(noise, least):
    views, wall = make_scene(noise)
    (kept,) = make_planes(views, [WALL], ONES, "mapping", "keep")
    (removed,) = make_planes(views, [WALL], ONES, "mapping", "remove")
    inside = np.s_[5:-5, 5:-5]
    assert compute_psnr(kept[inside], wall[inside]) < 22
    assert compute_psnr(removed[inside], wall[inside]) > least


def test_a_wall_behind_a_fence_in_16_bits_of_which_10_are_used():
    views, wall = make_scene()
    (removed,) = make_planes(views.astype(np.uint16) * 4, [WALL], ONES, "mapping", "remove")
    assert compute_psnr(removed[5:-5, 5:-5] / 4, wall[5:-5, 5:-5]) > 45


def test_opaque_alpha_changes_no_colour():
    views, _ = make_scene(noise=10)
    opaque = np.concatenate([views, np.full((*views.shape[:4], 1), 255, np.uint8)], axis=4)
    (removed,), (wanted,) = (make_planes(some, [WALL], ONES, "mapping", "remove") for some in (opaque, views))
    np.testing.assert_array_equal(removed[..., :3], wanted)
    assert np.abs(removed[..., 3] - 255).max() < 1e-3


def test_pixels_that_few_views_reach_are_not_black():
    """17x17 views of a plane at a disparity of 20: none of the 16 candidates may reach a pixel that others do."""
    plane = ndimage.gaussian_filter(np.random.default_rng(3).standard_normal((384, 384, 3)), (3, 3, 0))
    plane = (150 + 300 * plane).clip(80, 220).round().astype(np.uint8)
    views = np.stack([[plane[20 * v :, 20 * u :][:64, :64] for u in range(17)] for v in range(17)])
    (removed,) = make_planes(views, [20.0], np.ones((17, 17), np.float32), "mapping", "remove")
    np.testing.assert_allclose(removed, views[8, 8], atol=1)


def test_without_occluders_it_is_the_mean():
    """Two steps of the weighted mean of views without differences are the mean."""
    views, _ = make_scene()
    views = np.broadcast_to(views[3, 3], views.shape)
    (removed,) = make_planes(views, [0.0], ONES, "mapping", "remove")
    np.testing.assert_allclose(removed, views[3, 3], atol=1e-3)


def test_views_line_up_as_in_the_sum():
    views = np.random.default_rng(0).integers(0, 256, (3, 4, 12, 15, 3), dtype=np.uint8)
    weights = np.random.default_rng(1).random((3, 4)).astype(np.float32)
    samples, _ = _line_up(views, 0.7, weights, np.arange(12))
    (plane,) = refocus(views, [0.7], weights=weights)
    mean = np.average(samples, axis=0, weights=weights.reshape(-1))
    np.testing.assert_allclose(mean[3:-3, 3:-3], plane[3:-3, 3:-3], atol=1e-2)  # of 255: float32


def test_views_of_no_weight_and_views_that_do_not_reach():
    views = np.random.default_rng(2).integers(0, 256, (1, 3, 8, 20, 1), dtype=np.uint8)
    plane, far = make_planes(views, [6.0, 1e30], np.array([[0, 0, 1]], np.float32), "mapping", "remove")
    np.testing.assert_allclose(plane[:, 6:], views[0, 2, :, :14], atol=1e-3)
    assert (plane[:, :6] == 0).all()
    assert (far == 0).all()


def test_blocks_of_rows_are_the_same(monkeypatch):
    views, _ = make_scene()
    (expected,) = make_planes(views, [WALL], ONES, "mapping", "remove")
    monkeypatch.setattr(occluders, "_BLOCK", 1)
    (plane,) = make_planes(views, [WALL], ONES, "mapping", "remove")
    np.testing.assert_allclose(plane, expected, atol=1e-3)


def test_options_that_do_not_fit():
    views, _ = make_scene()
    with pytest.raises(InvalidOption, match="occluders: 'hide' is not known; give keep or remove"):
        make_planes(views, [0.0], ONES, "mapping", "hide")
    with pytest.raises(InvalidOption, match="not removed with the method window; give mapping"):
        make_planes(views, [0.0], ONES, "window", "remove")
