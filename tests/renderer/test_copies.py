import numpy as np
import pytest

from ciir.errors import InvalidGeometry, TooLarge
from ciir.renderer.copies import MAX_COPIED, place_surface
from ciir.renderer.surface import Surface, assemble_scene

RNG = np.random.default_rng(0)
VERTICES, NORMALS = RNG.normal(size=(7, 3)), RNG.normal(size=(7, 3))
FACES = np.array([[0, 1, 2], [2, 3, 4], [4, 5, 6]])
MATRICES = np.concatenate([RNG.normal(size=(5, 4, 4)), np.diag([1.0, 0.0, 2.0, 1.0])[None]])  # of both handednesses
MATRICES[:, 3] = 0, 0, 0, 1


def place_slowly(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, normals and faces of one copy, one by one."""
    linear = matrix[:3, :3]
    sign = -1 if np.linalg.det(linear) < 0 else 1
    minor = np.delete
    cofactors = np.array(
        [[(-1) ** (i + j) * np.linalg.det(minor(minor(linear, i, 0), j, 1)) for j in range(3)] for i in range(3)]
    )
    vertices = np.array([(matrix @ [*vertex, 1])[:3] for vertex in VERTICES])
    return vertices, np.array([sign * cofactors @ normal for normal in NORMALS]), FACES[:, ::sign]


def test_each_copy_as_the_slow_reference_places_it() -> None:
    assert {np.sign(np.linalg.det(matrix)) for matrix in MATRICES} == {-1, 0, 1}
    colors, uv = RNG.random((7, 4)).astype(np.float32), RNG.random((7, 2))
    placed = place_surface(Surface(VERTICES, FACES, NORMALS, colors=colors, uv=uv), MATRICES)
    for number, matrix in enumerate(MATRICES):
        vertices, normals, faces = place_slowly(matrix)
        of_copy = slice(7 * number, 7 * number + 7)
        assert placed.vertices[of_copy] == pytest.approx(vertices)
        assert placed.normals is not None
        assert placed.normals[of_copy] == pytest.approx(normals)
        assert np.array_equal(placed.faces[3 * number : 3 * number + 3], faces + 7 * number)
        assert placed.colors is not None
        assert np.array_equal(placed.colors[of_copy], colors)


def test_copies_are_lit_where_they_stand() -> None:
    turned = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
    faces = np.array([[0, 1, 2]])
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    copied = Surface(vertices, faces, copies=np.stack([np.eye(4), turned]))
    apart = [place_surface(Surface(vertices, faces), matrix[None]) for matrix in (np.eye(4), turned)]
    (found,), (expected,) = (assemble_scene(surfaces, name="a").parts for surfaces in ([copied], apart))
    assert found.colors == pytest.approx(expected.colors)
    assert len(np.unique(found.colors[:, 0])) == 2


def test_copies_have_a_limit_of_their_own() -> None:
    surface = Surface(VERTICES, FACES, copies=np.tile(np.eye(4), (7, 1, 1)))
    assert assemble_scene([surface], name="a", max_triangles=20).triangles == 21
    most = 21 // MAX_COPIED - 1
    with pytest.raises(TooLarge, match=f"21 triangles and 49 vertices in 7 copies; at most {MAX_COPIED * most} and"):
        assemble_scene([surface], name="a", max_triangles=most)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_matrices_of_copies_are_checked(value: float) -> None:
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = value
    with pytest.raises(InvalidGeometry, match=r"NaN or infinite|at most 1e"):
        assemble_scene([Surface(VERTICES, FACES, copies=matrices)], name="a")
