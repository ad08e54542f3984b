"""Orientation and light: axes, order and signs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.renderer.placement import AS_GIVEN, Placement
from ciir.renderer.shading import LIGHT, shade

ANGLES = st.floats(-720, 720)
FRONT, TOP, RIGHT = np.eye(3)[[2, 1, 0]]


def turn(points, axis, degrees):
    """Points `(n, 3)` rotated in complex numbers: counter-clockwise as seen from the axis's positive end."""
    across, up = (axis + 1) % 3, (axis + 2) % 3
    spun = (points[:, across] + 1j * points[:, up]) * np.exp(1j * np.radians(degrees))
    points = points.copy()
    points[:, across], points[:, up] = spun.real, spun.imag
    return points


@given(st.tuples(ANGLES, ANGLES, ANGLES), st.sampled_from(["y", "z"]), st.integers(0, 99))
def test_rotation_is_yaw_then_pitch_then_roll(rotate, up, seed):
    points = np.random.default_rng(seed).normal(size=(5, 3))
    upright = turn(points, 0, -90) if up == "z" else points
    expected = turn(turn(turn(upright, 1, rotate[0]), 0, rotate[1]), 2, rotate[2])
    matrix = Placement(up=up, rotate=rotate).rotation()
    np.testing.assert_allclose(points @ matrix.T, expected, atol=1e-12)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_the_object_as_given_is_not_touched():
    np.testing.assert_array_equal(AS_GIVEN.rotation(), np.eye(3))
    np.testing.assert_array_equal(AS_GIVEN.light_direction(), LIGHT)


@pytest.mark.parametrize(
    ("placement", "side", "faces"),
    [
        (Placement(up="z"), FRONT, TOP),  # z up: the top is up
        (Placement(up="z"), -TOP, FRONT),  # and -y, the front in CAD, faces the array
        (Placement(rotate=(90, 0, 0)), FRONT, RIGHT),
        (Placement(rotate=(0, 90, 0)), TOP, FRONT),
        (Placement(rotate=(0, 0, 90)), TOP, -RIGHT),
        (Placement(rotate=(90, 90, 0)), FRONT, RIGHT),  # pitch is about the array's x, which the front now lies along
        (Placement(up="z", rotate=(0, 90, 0)), FRONT, FRONT),  # seen from above
    ],
)
def test_where_a_side_of_the_mesh_faces(placement, side, faces):
    np.testing.assert_allclose(placement.rotation() @ side, faces, atol=1e-12)


@given(st.tuples(ANGLES, ANGLES, ANGLES), st.sampled_from(["y", "z"]), st.none() | st.tuples(ANGLES, ANGLES))
def test_light_stays_as_the_object_turns(rotate, up, light):
    placement = Placement(up=up, rotate=rotate, light=light)
    normals = np.random.default_rng(1).normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    fixed = Placement(light=light).light_direction()
    assert np.linalg.norm(fixed) == pytest.approx(1.0)
    np.testing.assert_allclose(
        shade(normals, placement.light_direction()), shade(normals @ placement.rotation().T, fixed), atol=1e-6
    )


@pytest.mark.parametrize(
    ("light", "direction"), [((0, 0), FRONT), ((90, 0), RIGHT), ((-90, 0), -RIGHT), ((50, 90), TOP), ((180, 0), -FRONT)]
)
def test_azimuth_and_elevation_of_the_light(light, direction):
    np.testing.assert_allclose(Placement(light=light).light_direction(), direction, atol=1e-12)
