import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.focus.depth_scale import DepthScale
from ciir.renderer.focus.model import Model, make_model
from ciir.renderer.focus.model.cameras import place_before_cameras
from ciir.renderer.lens_array import LensArray
from ciir.renderer.light_field import LightField

ROWS, COLS, PITCH = 100, 160, 2.0
CAMERAS = DepthScale.from_cameras(PITCH, 35, 36, COLS)
STRIPS = ((200.0, -np.inf, np.inf), (100.0, -20.0, 0.0), (50.0, 8.0, 18.0))
"""Depth, left and right end in millimetres: the first is a wall."""


def draw_texture(x, y, seed):
    """Sines of 2.5 to 12 per cent of the depth, at any places, as levels `(..., 3)`."""
    random = np.random.default_rng(seed)
    total = 0
    for length, angle in zip(random.uniform(5, 25, 40), random.uniform(0, 2 * np.pi, 40), strict=True):
        along = 2 * np.pi / length * (np.cos(angle) * x + np.sin(angle) * y)
        total = total + np.sin(along[..., np.newaxis] + random.uniform(0, 2 * np.pi, 3))
    return np.rint(255 * (0.5 + total / (2.2 * np.sqrt(40))).clip(0.01, 1))


def capture():
    """5x5 parallel cameras; each pixel shows the nearest strip on its ray."""
    views = np.empty((5, 5, ROWS, COLS, 3), np.uint8)
    tangent = 36 / (COLS * 35)
    for v, u in np.ndindex(5, 5):
        for seed, (depth, left, right) in enumerate(STRIPS):
            x = (u - 2) * PITCH + (np.arange(COLS) - (COLS - 1) / 2) * tangent * depth
            y = (2 - v) * PITCH - (np.arange(ROWS) - (ROWS - 1) / 2) * tangent * depth
            is_seen = (x >= left) & (x <= right)
            picture = draw_texture(*np.meshgrid(x * 200 / depth, y * 200 / depth), seed)
            views[v, u] = np.where(is_seen[:, np.newaxis], picture, views[v, u])
    return LightField(views, is_ordered=True, depth_sense="cameras")


def test_strips_come_back_at_their_depths_and_widths():
    model = make_model(capture(), cameras=CAMERAS)
    assert not model.notes
    depth = -model.vertices[:, 2]
    for number, (true, left, right) in enumerate(STRIPS):
        is_near = np.abs(depth / true - 1) < 0.03
        assert np.median(depth[is_near]) == pytest.approx(true, rel=0.005)
        if number:
            ends = np.quantile(model.vertices[is_near, 0], [0.005, 0.995])
            np.testing.assert_allclose(ends, (left, right), atol=0.5)  # a pixel is 1.03 and 0.51 mm there


def make_triangle(z):
    """A triangle in front of lenses of a pitch of 0.5, 10, 20 and 30 pixels right of and above the middle."""
    array = LensArray(ROWS, COLS, 5, 5, pitch=0.5, delta=0.1)
    across = 0.5 * np.array([[10.0, 10.0], [20.0, 10.0], [10.0, 30.0]])
    vertices = np.column_stack([across, np.full(3, z)])
    return Model(vertices, np.zeros((3, 3), np.uint8), np.array([[0, 1, 2]], np.int32), array)


@pytest.mark.parametrize(("zero", "aspect"), [(np.inf, 1.0), (400.0, 1.0), (np.inf, 2.0)])
@pytest.mark.parametrize("sense", ["cameras", "lenses"])
def test_a_point_lies_on_its_pixels_ray(zero, aspect, sense):
    cameras = DepthScale.from_cameras(PITCH, 35, 36, COLS, zero=zero, sense=sense)
    disparity = float(cameras.to_disparity(100)) * (1 if sense == "lenses" else -1)  # that of lenses
    placed = place_before_cameras(make_triangle(-disparity * 0.5 / 0.1), cameras, sense, aspect)
    pixel = 36 / COLS / 35 * 100
    x, y = pixel, pixel / aspect
    np.testing.assert_allclose(
        placed.vertices, [[10 * x, 10 * y, -100], [20 * x, 10 * y, -100], [10 * x, 30 * y, -100]]
    )


def test_what_may_be_infinitely_far_is_left_out_with_a_note():
    near, far = make_triangle(5.0), make_triangle(0.2)  # 1 and 0.04 pixels
    both = Model(
        np.concatenate([near.vertices, far.vertices]),
        np.zeros((6, 3), np.uint8),
        np.array([[0, 1, 2], [3, 4, 5]], np.int32),
        near.array,
    )
    placed = place_before_cameras(both, CAMERAS, "cameras")
    assert placed.faces.tolist() == [[0, 1, 2]]
    assert np.isfinite(placed.vertices).all()
    (note,) = placed.notes
    assert "50 % of the triangles are left out" in note
    with pytest.raises(InvalidOption, match="content beyond infinity; check the geometry of the cameras"):
        place_before_cameras(far, CAMERAS, "cameras")


@pytest.mark.parametrize("cameras", [3, DepthScale(1.0, is_inverse=True), DepthScale(1.0, is_inverse=False)])
def test_other_geometry_is_refused(cameras):
    with pytest.raises(InvalidOption, match=r"cameras: not the geometry.*; give what DepthScale.from_cameras returns"):
        make_model(LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)), cameras=cameras)


def test_lenses_and_cameras_are_not_given_together():
    with pytest.raises(InvalidOption, match="pitch and delta are those of a lens array"):
        make_model(LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)), cameras=CAMERAS, delta=0.1)
