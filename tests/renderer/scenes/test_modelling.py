import numpy as np
import pytest

from ciir.renderer.scenes.modelling import (
    blend,
    make_torus,
    revolve,
    rotate_vertices,
    sample_curve,
    sample_noise,
    smooth_step,
    to_rgba,
    to_vertex_colors,
)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("mi,mi->m", a, np.cross(b, c)).sum() / 6)


def test_a_revolved_profile_is_closed_with_its_outside_out() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 65)
    profile = np.stack([np.cos(angle), np.sin(angle)], 1)
    profile[[0, -1], 0] = 0
    vertices, faces, uv = revolve(profile, 128)
    assert volume(vertices, faces) == pytest.approx(4 / 3 * np.pi, rel=0.01)
    assert len(faces) == 2 * 128 * 64 - 2 * 128  # no slivers at the poles
    assert uv.min() == 0
    assert uv.max() == 1
    front = np.abs(vertices - [0, 0, 1]).sum(1) < 1e-9
    assert uv[front] == pytest.approx(np.array([[0, 0.5], [1, 0.5]]))  # the seam, exactly twice at one place
    assert np.ptp(vertices[front], axis=0).tolist() == [0, 0, 0]


def test_a_torus_is_closed_with_its_outside_out() -> None:
    assert volume(*make_torus(2, 0.5, 96, 64)) == pytest.approx(2 * np.pi**2 * 2 * 0.25, rel=0.01)


def test_rotation_is_counter_clockwise_from_the_positive_end() -> None:
    axes = np.eye(3)
    for axis in range(3):
        assert rotate_vertices(axes[[(axis + 1) % 3]], axis, 90)[0] == pytest.approx(axes[(axis + 2) % 3])


def test_a_curve_goes_through_its_points() -> None:
    points = [(0, 0), (1, 2), (3, 1), (4, 4)]
    through = sample_curve(points, 4)
    assert through == pytest.approx(np.array(points), abs=1e-6)


def test_noise_is_smooth_repeatable_and_within_range() -> None:
    line = np.stack([np.linspace(0, 9, 10_000), np.zeros(10_000), np.zeros(10_000)], 1)
    values = sample_noise(line, frequency=1, octaves=3, seed=5)
    assert np.array_equal(values, sample_noise(line, frequency=1, octaves=3, seed=5))
    assert not np.array_equal(values, sample_noise(line, frequency=1, octaves=3, seed=6))
    assert -1 <= values.min() < -0.1 < 0.1 < values.max() <= 1
    assert np.abs(np.diff(values)).max() < 0.01


def test_colours() -> None:
    assert blend((0, 0, 0), (1, 0.5, 0), np.array([-1.0, 0.5, 2])).tolist() == [[0, 0, 0], [0.5, 0.25, 0], [1, 0.5, 0]]
    assert smooth_step(0.5, 0.2, np.array([0.3, 0.5, 0.7])).tolist() == pytest.approx([0, 0.5, 1])
    assert to_rgba(np.array([[[0.0, 0.5, 2.0]]])).tolist() == [[[0, 128, 255, 255]]]
    assert to_vertex_colors(np.array([[0.0, 0.5, 2.0]])).tolist() == [[0, 0.5, 1, 1]]
