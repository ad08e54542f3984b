"""Planes of rendered points at known depths, on both depth senses, and of the duck."""

import numpy as np
import pytest

from ciir.renderer.focus.depth_scale import DepthScale
from ciir.renderer.focus.planes import refocus
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene
from tests.renderer.focus.test_planes import look_up
from tests.support.backends import place_scene, require_backend

SPACINGS = {"mapping": 0.25, "window": 0.25, "delta": 1.0}
"""Between planes, in pixels a view. Where views move by whole pixels, the outermost of 5 may be half a pixel off, which
is a quarter of a pixel a view.
"""


def render(scene, array, samples=4):
    backend = require_backend("raytrace")
    every = list(np.ndindex(array.pixels_v, array.pixels_u))
    pictures = np.stack(list(backend.render_views(scene, array, every, samples=samples)))[..., :3]
    return pictures.reshape(array.pixels_v, array.pixels_u, array.rows, array.cols, 3)


def make_sheet(depth, *, side=1.5):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2 - [0.3, -0.2, depth]
    return Scene((Part(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones((4, 4), np.float32)),))


def find_sharpest(views, scale, depth, method):
    """The disparity of the plane in which the picture has the most energy, minus the point's."""
    true = scale.to_disparity(depth)
    disparities = true + SPACINGS[method] * (np.arange(-8, 9) + 0.2)  # no plane is the point's own
    energy = [np.square(plane).sum() for plane in refocus(views.astype(np.float32), disparities, method=method)]
    return disparities[np.argmax(energy)] - true


@pytest.mark.parametrize("method", SPACINGS)
@pytest.mark.parametrize("sense", ["lenses", "cameras"])
@pytest.mark.parametrize("depth", [-9.0, 6.0, 14.0])
def test_a_point_before_a_lens_array_is_sharpest_at_its_depth(depth, sense, method):
    array = LensArray(41, 47, 7, 7, pitch=1.0, delta=0.1)
    views = render(make_sheet(depth), array)
    scale = DepthScale.from_lenses(array, sense)
    error = find_sharpest(views if sense == "lenses" else views[::-1, ::-1], scale, depth, method)
    assert abs(error) <= SPACINGS[method] / 2


@pytest.mark.parametrize("method", SPACINGS)
@pytest.mark.parametrize("sense", ["lenses", "cameras"])
@pytest.mark.parametrize("depth", [60.0, 130.0])
def test_a_point_before_cameras_is_sharpest_at_its_depth(depth, sense, method):
    """A blurred point, projected into each camera of an array: `f * (X - camera) / depth` from the middle."""
    cameras = {"pitch": 2.0, "focal_length": 35.0, "sensor_width": 36.0, "columns": 80}
    focal = cameras["columns"] * cameras["focal_length"] / cameras["sensor_width"]
    rows, cols = np.mgrid[:60, :80]
    views = np.empty((5, 5, 60, 80, 1))
    for v, u in np.ndindex(5, 5):
        x = 39.5 + focal * (1.0 - cameras["pitch"] * (u - 2)) / depth
        y = 29.5 + focal * (-0.5 - cameras["pitch"] * (v - 2)) / depth
        views[v, u, ..., 0] = 200 * np.exp(-(np.square(rows - y) + np.square(cols - x)) / 2)
    scale = DepthScale.from_cameras(**cameras, sense=sense)
    error = find_sharpest(views if sense == "cameras" else views[::-1, ::-1], scale, depth, method)
    assert abs(error) <= SPACINGS[method] / 2


def test_the_duck_is_the_sum_of_its_shifted_views():
    array = LensArray(48, 52, 5, 5)
    views = render(place_scene("duck.glb", array), array, samples=1).astype(np.float32) / 255
    disparity = 1.3
    total, reached = np.zeros((48, 52, 3)), np.zeros((48, 52, 1))
    for v, u in np.ndindex(5, 5):
        down, across = (
            np.array([look_up(np.eye(length), place - disparity * along, "mapping")[1] for place in range(length)])
            for along, length in ((v - 2, 48), (u - 2, 52))
        )
        total += np.einsum("yi,xj,ijc->yxc", down, across, views[v, u], optimize=True)
        reached += np.outer(down.sum(axis=1), across.sum(axis=1))[..., np.newaxis]
    (plane,) = refocus(views, [disparity])
    assert np.ptp(views) > 0.5
    np.testing.assert_allclose(plane, total / reached, atol=1e-5)
