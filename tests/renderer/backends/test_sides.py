"""The backs of faces: lit with reversed normals, but hidden for glTF's materials that aren't double-sided (glTF 2.0,
section 3.9.5).
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from ciir.renderer.backends.culling import cull_scene
from ciir.renderer.backends.embree import PASSED
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.readers import meshes
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import SUFFIXES
from ciir.renderer.scene import Part, Scene, Texture
from ciir.renderer.shading import LIGHT, encode_srgb, shade
from tests.support.backends import BACKENDS, place_scene, require_backend
from tests.support.meshes.gltf import Model

ARRAY = LensArray(12, 12, 3, 3)
FEW_LENSES = LensArray(3, 3, 12, 12)  # OpenGL then draws by lens
VIEWS = [(v, u) for v in range(3) for u in range(3)]


def place_sheet(yaw: float, *, double: bool, mirrored: bool = False, alpha: float = 1.0) -> Scene:
    """The square, which faces +z, in a node that may be mirrored, turned by `yaw` degrees before `ARRAY`."""
    model = Model(NORMAL=np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)))
    model.material |= {"doubleSided": double, "alphaMode": "OPAQUE" if alpha == 1 else "BLEND"}
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [1, 1, 1, alpha]}
    model.json["nodes"][0]["scale"] = [-1 if mirrored else 1, 1, 1]
    placement = Placement(rotate=(yaw, 0, 0))
    bundle = Bundle("a.glb", "a.glb", {"a.glb": model.glb()})
    scene = meshes.read(bundle, "a.glb", SUFFIXES[".glb"], placement)
    return scene.transform(frame_scene(scene, ARRAY, placement))


def expect_level(yaw: float, *, double: bool) -> float:
    normal = np.array([np.sin(np.radians(yaw)), 0, np.cos(np.radians(yaw))])
    return 255 * float(shade((-normal if double and normal[2] < 0 else normal)[None], LIGHT)[0])


def make_sheet(z: float, color: tuple[float, ...], *, faces_away: bool = False, hides_back: bool = True) -> Part:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 20.0 + [0, 0, z]
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    colors = np.tile(np.float32(color), (4, 1))
    return Part(corners, faces[:, ::-1] if faces_away else faces, colors, hides_back=hides_back)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("clear", [False, True])
def test_what_lies_behind_hidden_backs_is_seen(backend: str, clear: bool) -> None:
    hidden = [make_sheet(-10.0 - i, (1, 0, 0, 1), faces_away=True) for i in range(3)]
    front = make_sheet(-20, (0, 1, 0, 1))
    behind = make_sheet(-30, (0, 0, 1, 1), faces_away=True, hides_back=False)
    glass = replace(make_sheet(-9, (0, 0, 0, 0)), is_see_through=True)
    rendered = require_backend(backend)
    for parts, color, depth in (([*hidden, front, behind], 1, 20), ([*hidden, behind], 2, 30), (hidden, None, np.inf)):
        scene = Scene((glass, *parts) if clear else tuple(parts))
        (picture,) = rendered.render_views(scene, ARRAY, [(1, 1)])
        assert picture[6, 6].tolist() == [0 if color is None else 255 * (i in (color, 3)) for i in range(4)]
        (distance,) = rendered.render_depth(scene, ARRAY, [(1, 1)])
        assert distance[6, 6] == pytest.approx(depth, rel=1e-5)  # float32


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("turned", [0, 1, 2])
@pytest.mark.parametrize("yaw", [0, 180])
def test_both_windings_at_one_place_show_their_fronts(backend: str, turned: int, yaw: int) -> None:
    front = make_sheet(-20, (0, 1, 0, 1))
    corners = np.float32([[1, 0, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1], [0, 0, 0, 1]])
    back = replace(front, faces=np.roll(front.faces[:, ::-1], turned, axis=1), colors=corners)
    matrix = np.diag([-1.0, 1, -1, 1]) if yaw else np.eye(4)
    matrix[2, 3] = -40 if yaw else 0
    placed = Scene((front, back)).transform(matrix).parts
    scene = Scene((*placed, make_sheet(-30, (1, 1, 0, 1), hides_back=False)))
    (picture,) = require_backend(backend).render_views(scene, ARRAY, [(1, 1)])
    (expected,) = require_backend(backend).render_views(Scene((placed[1] if yaw else placed[0],)), ARRAY, [(1, 1)])
    assert np.abs(picture[1:-1, 1:-1].astype(int) - expected[1:-1, 1:-1]).max() <= 1
    assert expected[6, 6, 3] == 255


def test_a_ray_ends_after_64_hidden_backs_with_a_note() -> None:
    hidden = [make_sheet(-10.0 - i / 8, (1, 0, 0, 1), faces_away=True) for i in range(66)]
    notes: set[str] = set()
    scene = Scene((*hidden, make_sheet(-20, (0, 1, 0, 1))))
    (picture,) = RaytraceBackend().sample_views(scene, ARRAY, [(1, 1)], notes=notes)
    assert not picture.any()
    assert notes == {PASSED}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("yaw", [0.0, 40.0, 140.0, 180.0])
def test_the_side_that_is_seen_is_lit(backend: str, yaw: float, mirrored: bool, double: bool) -> None:
    placed, rendered = place_sheet(yaw, double=double, mirrored=mirrored), require_backend(backend)
    pictures = [*rendered.render_views(placed, ARRAY, VIEWS), rendered.render_eia(placed, FEW_LENSES)]
    for picture in pictures:
        covered = picture[..., 3] == 255
        assert covered.any() == (double or yaw < 90)
        assert picture[covered, :3] == pytest.approx(expect_level(yaw, double=double), abs=1)  # 8 bit


@pytest.mark.parametrize("yaw", [0.0, 180.0])
def test_sides_of_a_see_through_sheet_that_is_culled(yaw: float) -> None:
    placed = place_sheet(yaw, double=True, alpha=0.5)
    placed = cull_scene(placed, LensArray(1, 1, 3, 3), [(1, 1)])  # keeps the triangles on the axis
    (picture,) = require_backend("raytrace").render_views(placed, ARRAY, [(1, 1)])
    assert picture[6, 6, :3] == pytest.approx(expect_level(yaw, double=True) / 2, abs=1)  # before black


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_box_whose_walls_face_inwards_is_lit_as_any_box(backend: str) -> None:
    placed = place_scene("webp-box.glb", ARRAY, Placement(rotate=(30, 20, 0)))  # shows its front, left and top
    (picture,) = require_backend(backend).render_views(placed, ARRAY, [(1, 1)])
    levels = 255 * encode_srgb(np.array(0.8)) * shade(np.array([[0.0, 0, 1], [-1, 0, 0], [0, 1, 0]]))
    found = np.unique(picture[picture[..., 3] == 255, 0])
    assert found == pytest.approx(np.sort(levels), abs=1)


def place_file(name: str, data: bytes, yaw: float) -> Scene:
    """A mesh file, turned by `yaw` degrees before `ARRAY`."""
    placement = Placement(rotate=(yaw, 0, 0))
    scene = meshes.read(Bundle(name, name, {name: data}), name, SUFFIXES[name[-4:]], placement)
    return scene.transform(frame_scene(scene, ARRAY, placement))


SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
SHEETS = {
    "without normals.obj": SQUARE + b"f 1 2 3 4\n",
    "normals.obj": SQUARE + b"vn 0 0 1\nf 1//1 2//1 3//1 4//1\n",
    "normals that contradict the corners.obj": SQUARE + b"vn 0 0 1\nf 4//1 3//1 2//1 1//1\n",
    "two sheets.obj": SQUARE + b"f 1 2 3 4\nf 4 3 2 1\n",
    "a.off": b"OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
} | {
    f"a.{suffix}": trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]]).export(file_type=suffix)
    for suffix in ("ply", "stl")
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", SHEETS)
@pytest.mark.parametrize("yaw", [0.0, 40.0, 140.0, 180.0])
def test_both_sides_are_lit_in_other_formats(name: str, backend: str, yaw: float) -> None:
    (picture,) = require_backend(backend).render_views(place_file(name, SHEETS[name], yaw), ARRAY, [(1, 1)])
    covered = picture[..., 3] == 255
    assert covered.any()
    assert picture[covered, :3] == pytest.approx(0.8 * expect_level(yaw, double=True), abs=1)  # 8 bit


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_closed_mesh_that_is_inside_out_looks_as_any(backend: str) -> None:
    ball = trimesh.creation.icosphere(2)
    views = []
    for faces in (ball.faces, ball.faces[:, ::-1]):
        data = trimesh.Trimesh(ball.vertices, faces, process=False).export(file_type="ply")
        views += require_backend(backend).render_views(place_file("a.ply", data, 0), ARRAY, [(1, 1)])
    assert np.ptp(views[0][..., 0]) > 50
    assert np.abs(views[0].astype(int) - views[1]).max() <= 1


@pytest.mark.parametrize("backend", BACKENDS)
def test_backs_behind_cut_out_faces_are_lit(backend: str) -> None:
    front, back = make_sheet(-20, (0.2, 0, 0, 1), hides_back=False), make_sheet(-20, (0.9, 0, 0, 1)).colors[:, :3]
    texture = Texture(np.array([[[255] * 4, [255, 255, 255, 0]]], np.uint8), is_nearest=True)
    uv = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    cut = replace(front, back_colors=back, texture=texture, uv=uv, alpha_cutoff=0.5)
    behind = replace(cut, vertices=cut.vertices - [0, 0, 5], faces=cut.faces[:, ::-1], uv=1 - uv)
    (picture,) = require_backend(backend).render_views(Scene((cut, behind)), ARRAY, [(1, 1)])
    assert picture[6, [2, 9], 0] == pytest.approx([0.2 * 255, 0.9 * 255], abs=1)
