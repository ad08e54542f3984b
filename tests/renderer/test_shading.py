import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.renderer import shading
from ciir.renderer.scenes.modelling import revolve
from ciir.renderer.shading import (
    CREASE,
    FLAT,
    LIGHT,
    compute_normals,
    cross,
    encode_srgb,
    is_solid,
    normalize,
    number_positions,
    shade,
)

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def find_flat(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns the unit normals of faces, `(m, 3)`."""
    corners = vertices[faces]
    return normalize(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def compute_slowly(vertices: np.ndarray, faces: np.ndarray, crease: float) -> np.ndarray:
    """Returns the normals of corners `(m, 3, 3)`, one pair of corners at a time."""
    flat, normals = find_flat(vertices, faces), np.zeros((*faces.shape, 3))
    for (face, corner), vertex in np.ndenumerate(faces):
        for (other, at), place in np.ndenumerate(faces):
            angle_between = np.degrees(np.arccos(np.clip(flat[face] @ flat[other], -1, 1)))
            if (vertices[place] == vertices[vertex]).all() and angle_between <= crease:
                a, b = (normalize(vertices[faces[other, (at + i) % 3]] - vertices[place]) for i in (1, 2))
                normals[face, corner] += np.arccos(np.clip(a @ b, -1, 1)) * flat[other]
    return normalize(normals)


def make_gear(teeth: int) -> tuple[np.ndarray, np.ndarray]:
    """Makes a flat-faced gear with its axis along z, and inner corners between its teeth."""
    count = 4 * teeth
    radius, angle = np.where(np.arange(count) % 4 < 2, 1, 0.8), np.arange(count) * 2 * np.pi / count
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    vertices = np.concatenate([np.c_[rim, np.full(count, z)] for z in (0.25, -0.25)] + [[[0, 0, 0.25], [0, 0, -0.25]]])
    a, b = np.arange(count), (np.arange(count) + 1) % count
    top, under = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    sides = [(top, a, b), (under, b + count, a + count), (a, a + count, b + count), (a, b + count, b)]
    return vertices, np.concatenate([np.stack(side, axis=1) for side in sides])


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
    assert np.array_equal(CUBE[source][faces], CUBE[CUBE_FACES])
    assert np.allclose(normals[faces], find_flat(CUBE, CUBE_FACES)[:, None])


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


@pytest.mark.parametrize("soup", [False, True])
def test_flat_faces_at_inner_corners_have_one_normal(soup: bool) -> None:
    vertices, faces = make_gear(12)
    if soup:
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    _, new_faces, normals = compute_normals(vertices, faces)
    caps = np.abs(find_flat(vertices, faces)[:, 2]) > 0.5
    assert caps.sum() == 96
    assert np.allclose(np.abs(normals[new_faces[caps]]), (0, 0, 1))


def make_rough(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Makes faces between few positions, some of them repeated: up to 30 faces meet at one position, at any angles."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(8, 3))[rng.integers(0, 8, 20)]
    faces = np.array([rng.permutation(20)[:3] for _ in range(60)])
    return vertices, faces[
        (np.ptp(vertices[faces], axis=1) > 0).any(axis=1) & (find_flat(vertices, faces) != 0).any(axis=1)
    ]


@pytest.mark.parametrize("pairs", [1, 1 << 18])
@pytest.mark.parametrize("crease", [CREASE, 80.0])
def test_normals_are_those_of_the_slow_reference(monkeypatch: pytest.MonkeyPatch, crease: float, pairs: int) -> None:
    monkeypatch.setattr(shading, "_PAIRS", pairs)
    bumpy = revolve([(0.2, 0), (1, 0.3), (0.7, 1.0), (0.1, 1.2)], 7)[:2]
    for vertices, faces in (make_gear(3), bumpy, (CUBE, CUBE_FACES), make_rough(0), make_rough(1)):
        source, new_faces, normals = compute_normals(vertices, faces, crease)
        assert np.array_equal(source[new_faces], faces)
        assert np.array_equal(source[: len(vertices)], np.arange(len(vertices)))
        assert np.allclose(normals[new_faces], compute_slowly(vertices, faces, crease), atol=1e-6)


def test_corners_without_a_crease_share_their_vertices() -> None:
    vertices, faces = make_gear(12)
    source, _, _ = compute_normals(vertices, faces)
    assert not np.isin(source[len(vertices) :], [96, 97]).any()  # the centres of both caps
    assert len(source) <= len(vertices) + 3 * 96  # the cap and two sides at each position of the rim


def test_faces_over_the_limit_at_a_position_keep_their_own_normals(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces, _ = revolve([(1, 0), (0, 3)], 32)
    faces = faces[(find_flat(vertices, faces) != 0).any(axis=1)]
    at_apex = vertices[faces][:, :, 1] == 3
    flat = np.repeat(find_flat(vertices, faces)[:, None], 3, axis=1)[at_apex]
    for limit, is_smooth in ((32, True), (31, False)):
        monkeypatch.setattr(shading, "MAX_FACES", limit)
        _, new_faces, normals = compute_normals(vertices, faces)
        assert np.allclose(normals[new_faces][at_apex], flat) != is_smooth


def test_flat_shading_keeps_the_normal_of_every_face() -> None:
    vertices, faces = make_gear(5)
    _, new_faces, normals = compute_normals(vertices, faces, FLAT)
    assert np.allclose(normals[new_faces], find_flat(vertices, faces)[:, None])


def test_cross_products_are_those_of_numpy() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 9, 3))
    assert np.array_equal(cross(a, b), np.cross(a, b))


@pytest.mark.parametrize("shift", [0.0, 1e6])
@pytest.mark.parametrize("soup", [False, True])
def test_solids_are_closed_with_their_fronts_outside(soup: bool, shift: float) -> None:
    def check(vertices: np.ndarray, *groups: np.ndarray) -> bool:
        faces = np.concatenate(groups)
        if soup:
            return is_solid(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
        return is_solid(vertices, faces)

    gear, gear_faces = make_gear(5)
    both = np.concatenate([gear, CUBE + 3]) + shift
    cube = CUBE_FACES + len(gear)
    inside_out = cube[:, ::-1]
    assert check(both, gear_faces, cube)
    assert not check(both, gear_faces, inside_out)
    assert not check(both, inside_out, gear_faces)
    assert not check(both, gear_faces[:, ::-1], inside_out)
    assert not check(both, gear_faces, cube[:-1])  # open
    assert not check(both, gear_faces, np.concatenate([cube[:-1], inside_out[-1:]]))  # one face is turned
    assert not check(both, gear_faces, cube[:1], inside_out[:1])  # a sheet of two faces


def test_a_body_in_two_pieces_is_solid_and_no_faces_are_not() -> None:
    assert is_solid(CUBE, CUBE_FACES[np.random.default_rng(0).permutation(12)])
    assert not is_solid(np.zeros((0, 3)), np.zeros((0, 3), np.int64))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_normals_are_unit_and_within_the_crease_of_their_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(20, 3))
    faces = np.array([rng.permutation(20)[:3] for _ in range(30)])
    source, new_faces, normals = compute_normals(vertices, faces)
    assert np.array_equal(source[new_faces], faces)
    flat, used = find_flat(vertices, faces), normals[new_faces]
    assert np.allclose(np.linalg.norm(used, axis=-1), 1)
    assert (np.einsum("mci,mi->mc", used, flat) > np.cos(np.radians(CREASE + 0.001))).all()
