from dataclasses import replace

import numpy as np
import pytest
import trimesh

from ciir.errors import InvalidGeometry, TooLarge, Unreadable
from ciir.renderer.scene import Part, Texture
from ciir.renderer.shading import shade
from ciir.renderer.surface import MAX_COORDINATE, Back, Surface, assemble_scene

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
CUBE, CUBE_FACES = np.array(trimesh.creation.box().vertices), np.array(trimesh.creation.box().faces)
FRONT = float(shade(np.array([[0.0, 0, 1]]))[0])


def test_a_square_is_lit_from_its_computed_normal() -> None:
    scene = assemble_scene([Surface(SQUARE, FACES, color=(0.5, 1.0, 0.0, 1.0))], name="a")
    (part,) = scene.parts
    assert part.colors == pytest.approx(np.tile([0.5 * FRONT, FRONT, 0, 1], (4, 1)))
    assert part.vertices.dtype == np.float64
    assert part.faces.dtype == np.int32
    assert part.colors.dtype == np.float32
    assert scene.notes == ()


def test_given_normals_are_used_whatever_their_length() -> None:
    normals = np.tile([0.0, 5.0, 0.0], (4, 1))
    (part,) = assemble_scene([Surface(SQUARE, FACES, normals=normals)], name="a").parts
    assert part.colors[:, 0] == pytest.approx(shade(np.array([[0.0, 1, 0]]))[0])


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_unusable_normals_are_computed(bad: float) -> None:
    normals = np.tile([0.0, 1.0, 0.0], (4, 1))
    normals[2] = bad
    (part,) = assemble_scene([Surface(SQUARE, FACES, normals=normals)], name="a").parts
    assert part.colors[:, 0] == pytest.approx(FRONT)


def test_vertex_colours_multiply_the_material_and_opaque_means_alpha_1() -> None:
    colors = np.full((4, 4), 0.5, np.float32)
    (part,) = assemble_scene([Surface(SQUARE, FACES, color=(0.5, 1, 1, 0.5), colors=colors, lit=False)], name="a").parts
    assert part.colors == pytest.approx(np.tile([0.25, 0.5, 0.5, 1.0], (4, 1)))
    masked = Surface(SQUARE, FACES, color=(0.5, 1, 1, 0.5), colors=colors, lit=False, alpha_cutoff=0.1)
    assert assemble_scene([masked], name="a").parts[0].colors[:, 3] == pytest.approx(0.25)


def test_one_part_for_each_texture_and_cutoff() -> None:
    texture = Texture(np.zeros((1, 1, 4), np.uint8))
    textured = Surface(SQUARE, FACES, uv=SQUARE[:, :2], texture=texture)
    red = Surface(SQUARE + 1, FACES, color=(1, 0, 0, 1), lit=False)
    blue = Surface(SQUARE + 2, FACES, color=(0, 0, 1, 1), lit=False)
    scene = assemble_scene([red, textured, blue], name="a")
    assert [len(part.faces) for part in scene.parts] == [4, 2]
    assert scene.parts[0].vertices[scene.parts[0].faces[3]].tolist() == (SQUARE + 2)[FACES[1]].tolist()
    assert scene.parts[0].colors[scene.parts[0].faces[3], 2].tolist() == [1, 1, 1]
    assert scene.parts[1].texture is texture
    assert scene.bounds().tolist() == [[0, 0, 0], [3, 3, 2]]


def test_light_has_no_seam_between_materials() -> None:
    bend = np.array([[0.0, 0, 0], [1, 0, 0.2], [1, 1, 0.2], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    halves = [Surface(bend, np.array([[0, 1, 2], [0, 2, 3]])), Surface(bend, np.array([[1, 4, 5], [1, 5, 2]]))]
    (part,) = assemble_scene(halves, name="a").parts
    on_the_bend = part.vertices[:, 0] == 1
    assert on_the_bend.sum() == 4
    assert np.ptp(part.colors[on_the_bend, 0]) < 1e-6


def test_vertices_that_no_triangle_uses_are_dropped() -> None:
    vertices = np.concatenate([[[np.nan, 0, 0], [1e30, 0, 0]], SQUARE])
    (part,) = assemble_scene([Surface(vertices, FACES + 2)], name="a").parts
    assert len(part.vertices) == 4


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_vertex_that_is_not_finite(bad: float) -> None:
    vertices = SQUARE.copy()
    vertices[1, 1] = bad
    with pytest.raises(InvalidGeometry, match="a: a vertex is NaN or infinite"):
        assemble_scene([Surface(vertices, FACES)], name="a")


def test_a_coordinate_out_of_range() -> None:
    assemble_scene([Surface(SQUARE * MAX_COORDINATE, FACES)], name="a")
    with pytest.raises(InvalidGeometry, match=r"a: a coordinate is 1e\+30; at most 1e\+09"):
        assemble_scene([Surface(SQUARE * -1e30, FACES)], name="a")


def test_no_triangles() -> None:
    for surfaces in ([], [Surface(SQUARE, np.empty((0, 3), np.int64))]):
        with pytest.raises(InvalidGeometry, match="a: no triangles"):
            assemble_scene(surfaces, name="a")


def test_only_triangles_of_zero_area() -> None:
    line = np.array([[0.0, 0, 0], [1, 1, 1], [3, 3, 3]])
    for faces in ([[0, 1, 2]], [[0, 0, 1]], [[1, 1, 1]]):
        with pytest.raises(InvalidGeometry, match="all 1 triangles have zero area"):
            assemble_scene([Surface(line, np.array(faces))], name="a")


def test_some_triangles_of_zero_area_are_dropped_with_a_note() -> None:
    scene = assemble_scene([Surface(SQUARE, np.array([[0, 1, 2], [0, 0, 2], [0, 2, 3]]))], name="a")
    assert scene.triangles == 2
    assert scene.notes == ("1 of 3 triangles have zero area and are left out",)


def test_a_small_triangle_far_from_the_origin_stays() -> None:
    assert assemble_scene([Surface(SQUARE * 1e-3 + 1e3, FACES)], name="a").triangles == 2


@pytest.mark.parametrize("index", [-1, 4, 2**40])
def test_a_face_of_a_missing_vertex(index: int) -> None:
    with pytest.raises(Unreadable, match=f"a: a face names vertex {index} but there are 4"):
        assemble_scene([Surface(SQUARE, np.array([[0, 1, 2], [0, 2, index]]))], name="a")


def test_too_many_triangles() -> None:
    with pytest.raises(TooLarge, match="a: 2 triangles and 4 vertices; at most 1 and 3 are read; decimate"):
        assemble_scene([Surface(SQUARE, FACES)], name="a", max_triangles=1)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
def test_unusable_colours_and_texture_coordinates_are_zero_with_a_note(bad: float) -> None:
    colors = np.ones((4, 4), np.float32)
    uv = SQUARE[:, :2].copy()
    colors[1, 2] = uv[3, 0] = bad
    surface = Surface(SQUARE, FACES, colors=colors, uv=uv, texture=Texture(np.zeros((1, 1, 4), np.uint8)), lit=False)
    scene = assemble_scene([surface], name="a")
    (part,) = scene.parts
    assert part.colors[1].tolist() == [1, 1, 0, 1]
    assert part.uv is not None
    assert part.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert scene.notes == (
        "1 vertices have a colour that is NaN, infinite or too large: read as 0",
        "1 vertices have a texture coordinate that is NaN, infinite or too large: read as 0",
    )


def test_many_surfaces_with_the_same_error_make_one_note() -> None:
    bad = Surface(SQUARE, FACES, colors=np.full((4, 4), np.nan, np.float32))
    assert assemble_scene([bad] * 3, name="a").notes == (
        "12 vertices have a colour that is NaN, infinite or too large: read as 0",
    )


@pytest.mark.parametrize("back", ["either", "lit", "hidden"])
def test_the_front_is_where_given_normals_point_if_either_side_may_be(back: Back) -> None:
    faces = np.array([FACES[0], FACES[1, ::-1]])
    normals = np.tile([0.0, 0.0, 2.0], (4, 1))
    (part,) = assemble_scene([Surface(SQUARE, faces, normals=normals, back=back)], name="a").parts
    assert find_turned(part).tolist() == [False, back != "either"]
    assert part.hides_back == (back == "hidden")


def find_turned(part: Part) -> np.ndarray:
    """Returns whether the front of each face is below."""
    a, b, c = part.vertices[part.faces].swapaxes(0, 1)
    return np.cross(b - a, c - a)[:, 2] < 0


def test_backs_that_are_never_seen_have_no_colours() -> None:
    def has_backs(**changes: object) -> bool:
        surface = replace(Surface(CUBE, CUBE_FACES), **changes)  # type: ignore[arg-type]
        (part,) = assemble_scene([surface], name="a").parts
        if part.back_colors is not None:
            front = part.colors[:, :3] / surface.color[:3]
            assert part.back_colors / surface.color[:3] == pytest.approx(2 * 0.6 - front)  # 0.6: the ambient light
        return part.back_colors is not None

    assert not has_backs()
    assert not has_backs(lit=False, faces=CUBE_FACES[1:])
    assert not has_backs(back="hidden", faces=CUBE_FACES[1:])
    assert has_backs(back="lit")
    assert has_backs(faces=CUBE_FACES[1:])
    assert has_backs(faces=CUBE_FACES[:, ::-1])
    assert has_backs(is_see_through=True, color=(0.5, 1.0, 1.0, 0.5))
    assert has_backs(alpha_cutoff=0.5)
    assert not has_backs(copies=np.stack([np.eye(4), np.diag([-1.0, 2, 3, 1])]))


def test_normals_over_several_surfaces_are_those_of_each_corner() -> None:
    shifts = (0, 3, 6)
    surfaces = [Surface(CUBE + shift, CUBE_FACES, color=(0.1 + shift / 10, 0, 0, 1)) for shift in shifts]
    smooth = Surface(SQUARE + 9, FACES, color=(0, 1, 0, 1))
    (part, square) = assemble_scene([surfaces[0], smooth, *surfaces[1:]], name="a").parts
    assert len(square.vertices) == 4
    for number, surface in enumerate(surfaces):
        (alone,) = assemble_scene([surface], name="a").parts
        faces = part.faces[12 * number : 12 * number + 12]
        assert np.array_equal(part.vertices[faces], alone.vertices[alone.faces])
        assert np.array_equal(part.colors[faces], alone.colors[alone.faces])
