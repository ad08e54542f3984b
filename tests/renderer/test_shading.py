import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.renderer.scenes.modelling import revolve
from ciir.renderer.shading import LIGHT, compute_normals, encode_srgb, normalize, number_positions, shade

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def test_encode_is_the_srgb_curve() -> None:
    # 0.5 -> 188 and 0.2 -> 124 of 255 are the figures of published tables.
    assert np.rint(encode_srgb(np.array([0.0, 0.2, 0.5, 1.0])) * 255).tolist() == [0, 124, 188, 255]
    assert encode_srgb(np.array([-1.0, 2.0])).tolist() == [0.0, 1.0]
    assert encode_srgb(np.array([0.001]))[0] == pytest.approx(0.01292)


def test_encoded_factors_multiply_like_linear_ones_up_to_the_toe() -> None:
    a, b = np.meshgrid(np.linspace(0.2, 1, 9), np.linspace(0.2, 1, 9))
    assert np.abs(encode_srgb(a) * encode_srgb(b) - encode_srgb(a * b)).max() < 0.02


def test_light_from_the_upper_left_front() -> None:
    assert pytest.approx(np.array([-0.4, 0.6, 0.7]) / np.sqrt(1.01)) == LIGHT
    normals = np.array([LIGHT, -LIGHT, [0, 0, 1], [0, 0, -1]])
    assert shade(normals) == pytest.approx([1.0, 0.2, 0.6 + 0.4 * LIGHT[2], 0.6 - 0.4 * LIGHT[2]])


def test_positions_are_numbered_exactly() -> None:
    place, count = number_positions(np.array([[0.0, 1, 2], [-0.0, 1, 2], [0, 2, 1], [0, 1, 2]]))
    assert count == 2
    assert place[0] == place[1] == place[3] != place[2]


def test_positions_with_equal_hashes_are_numbered_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices = np.array([[0.0, 1, 2], [5, 6, 7], [0, 1, 2]])
    real = np.unique
    first_call = iter([True])

    def colliding(values: np.ndarray, **options: object) -> object:
        return real(np.zeros_like(values) if next(first_call, False) else values, **options)

    monkeypatch.setattr("ciir.renderer.shading.np.unique", colliding)
    place, count = number_positions(vertices)
    assert count == 2
    assert place[0] == place[2] != place[1]


def test_a_cube_keeps_its_edges() -> None:
    source, faces, normals = compute_normals(CUBE, CUBE_FACES)
    corners = CUBE[source][faces]
    flat = normalize(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    assert np.array_equal(CUBE[source][faces], CUBE[CUBE_FACES])
    assert np.allclose(normals[faces], flat[:, None])


def test_a_sphere_is_smooth_across_its_seam_and_poles() -> None:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 33)
    radius = np.cos(turn)
    radius[[0, -1]] = 0
    vertices, faces, _ = revolve(np.stack([radius, np.sin(turn)], 1), 64)
    source, new_faces, normals = compute_normals(vertices, faces)
    assert len(source) == len(vertices)  # nothing was split
    used = np.unique(new_faces)
    assert np.abs(normals[used] - vertices[source][used]).max() < 0.01


def test_soup_and_shared_vertices_have_the_same_normals() -> None:
    rng = np.random.default_rng(0)
    vertices, faces, _ = revolve([(0.2, 0), (1, 0.3), (0.7, 1.0)], 12)
    vertices = vertices + rng.normal(0, 0.01, vertices.shape).round(3)
    shared = compute_normals(vertices, faces)
    soup = compute_normals(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    assert np.allclose(shared[2][shared[1]], soup[2][soup[1]])


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_normals_are_unit_and_within_the_crease_of_their_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(20, 3))
    faces = np.array([rng.permutation(20)[:3] for _ in range(30)])
    source, new_faces, normals = compute_normals(vertices, faces)
    assert np.array_equal(source[new_faces], faces)
    corners = vertices[faces]
    flat = normalize(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    used = normals[new_faces]
    assert np.allclose(np.linalg.norm(used, axis=-1), 1)
    assert (np.einsum("mci,mi->mc", used, flat) > np.cos(np.radians(40.001))).all()
