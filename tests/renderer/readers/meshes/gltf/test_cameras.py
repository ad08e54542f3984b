import numpy as np
import pytest

from ciir.errors import InvalidGeometry, InvalidOption, Unreadable
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.readers.meshes.pose import MeshPose
from ciir.renderer.scene import Scene
from tests.support.meshes import FRONT
from tests.support.meshes.gltf import SQUARE, Model

HALF = float(np.sqrt(0.5))


def filmed_model() -> Model:
    """The square with three cameras: as the array looks, from the left (along +x), and on its side."""
    model = Model()
    model.json["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 2, "znear": 0.1}},
        {"name": "Close-up", "type": "orthographic", "orthographic": {"xmag": 3, "ymag": 3, "znear": 0, "zfar": 9}},
    ]
    model.json["nodes"] += [
        {"camera": 0, "translation": [3, 4, 5], "scale": [2, 2, 2]},
        {"camera": 1, "name": "Left", "rotation": [0, -HALF, 0, HALF], "translation": [-1, 0, 0]},
        {"children": [4], "rotation": [0, 0, HALF, HALF], "translation": [0, 0, 1]},
        {"camera": 0, "name": "1"},
    ]
    model.json["scenes"] = [{"nodes": [0, 1, 2, 3]}]
    return model


def test_a_camera_that_looks_as_the_array_does() -> None:
    scene = filmed_model().read(MeshPose(camera="0"))
    assert scene.parts[0].vertices == pytest.approx(SQUARE - [3, 4, 5])
    (note,) = scene.notes
    assert note.startswith("camera 0: its picture fits into the centre view at the subject's distance; nearer or")
    # "or none" refers to quilts
    assert note.endswith("a different size than in the camera's picture, as views have a different perspective or none")


@pytest.mark.parametrize("camera", ["1", "Left", "Close-up"])
def test_seen_from_the_left_by_number_and_by_either_name(camera: str) -> None:
    (part,) = filmed_model().read(MeshPose(camera=camera)).parts
    x, y, _ = SQUARE.T
    # The camera at x = -1 looks along +x: +z is to its right, and what is far from it lies at large x.
    assert part.vertices == pytest.approx(np.stack([0 * x, y, -1 - x], axis=1), abs=1e-6)


def test_an_orthographic_cameras_picture_is_noted_as_it_is_at_all_distances() -> None:
    assert filmed_model().read(MeshPose(camera="Left")).notes[0] == "camera 1: its picture fits into the centre view"


def test_a_field_of_view_of_half_a_turn_or_more_is_refused() -> None:
    model = filmed_model()
    model.json["cameras"][0]["perspective"]["yfov"] = 7.0
    with pytest.raises(Unreadable, match="camera 0 has no field of view"):
        model.read(MeshPose(camera="0"))


def test_what_lies_behind_a_camera_is_left_out() -> None:
    model = filmed_model()
    model.json["nodes"][2]["translation"] = [0.5, 0, 0]
    both = model.read(MeshPose(camera="1"))
    assert both.triangles == 2
    model.json["nodes"][0]["scale"] = [1, 1, 0.5]
    model.primitive["indices"] = model.add(np.array([0, 1, 2, 0, 3, 2], np.uint16))
    model.json["nodes"].append({"mesh": 0, "translation": [-3, 0, 0]})
    model.json["scenes"][0]["nodes"].append(5)
    scene = model.read(MeshPose(camera="1"))
    assert scene.triangles == 2
    assert scene.notes[1] == "2 triangles lie behind the camera or outside its range, and are left out"
    assert scene.bounds() == pytest.approx(both.bounds(), abs=1e-6)
    model.json["nodes"][2]["translation"] = [5, 0, 0]
    with pytest.raises(InvalidGeometry, match="all of it lies behind the camera; give another camera"):
        model.read(MeshPose(camera="1"))


def test_light_comes_from_the_array_not_from_the_file() -> None:
    model = filmed_model()
    model.json["nodes"][0]["rotation"] = [0, -HALF, 0, HALF]  # faces the camera on the left
    assert model.read(MeshPose(camera="Left")).parts[0].colors[:, 0] == pytest.approx(FRONT)


def test_a_camera_on_its_side_is_upright_and_its_parents_turn_it() -> None:
    (part,) = filmed_model().read(MeshPose(camera="2")).parts
    x, y, z = SQUARE.T
    # Its x is the file's y, its y the file's -x.
    assert part.vertices == pytest.approx(np.stack([y, -x, z - 1], axis=1), abs=1e-6)


def test_a_camera_that_is_animated() -> None:
    model = filmed_model()
    model.animate(1, "rotation", [0, 1], np.array([[0, 0, 0, 1], [0, -HALF, 0, HALF]], np.float32))
    model.animate(1, "translation", [0, 1], np.array([[3, 4, 5], [-1, 0, 0]], np.float32))
    posed, left = (model.read(pose).parts[0].vertices for pose in (MeshPose(1.0, "0"), MeshPose(camera="Left")))
    assert posed == pytest.approx(left, abs=1e-6)


def test_cameras_that_are_not_there() -> None:
    with pytest.raises(InvalidOption, match=r"camera: 'Rear' is not in a\.glb; give 0, 1 \(Left\), 2 \(1\)$"):
        filmed_model().read(MeshPose(camera="Rear"))
    with pytest.raises(InvalidOption, match=r"camera: a\.glb holds no camera; leave it out"):
        Model().read(MeshPose(camera="0"))
    model = filmed_model()
    model.json["nodes"][1]["scale"] = [1, 1, 0]
    with pytest.raises(Unreadable, match="camera 0 has no orientation"):
        model.read(MeshPose(camera="0"))
    for yfov, aspect in ((0, 1), (4, 1), (float("nan"), 1), (1e400, 1), (1, 1e300), (1, -1)):
        model = filmed_model()
        model.json["cameras"][0]["perspective"] |= {"yfov": yfov, "aspectRatio": aspect}
        with pytest.raises(Unreadable, match="camera 0 has no field of view"):
            model.read(MeshPose(camera="0"))


@pytest.mark.parametrize(("near", "far"), [(float("nan"), 1.0), (0.1, float("nan")), (1e300, 1.0), (3.0, 2.0)])
def test_a_camera_without_a_range(near: float, far: float) -> None:
    model = filmed_model()
    model.json["cameras"][0]["perspective"] |= {"znear": near, "zfar": far}
    with pytest.raises(InvalidGeometry, match="all of it lies behind the camera"):
        model.read(MeshPose(camera="0"))


def test_a_subject_at_the_camera_itself_is_none() -> None:
    model = filmed_model()
    model.json["cameras"][0]["perspective"]["znear"] = 0
    model.json["nodes"][1]["translation"] = [0.5, 0.5, 1e-9]
    assert model.read(MeshPose(camera="0")).window is None


DISTANCE = 4.0
"""Of the square, whose plane faces the camera."""


def film_square(camera: dict[str, object]) -> Scene:
    """The square off the axis, and a sliver of it at twice the distance."""
    model = Model()
    model.json["cameras"] = [{"type": next(iter(camera)), **camera}]
    model.json["nodes"] += [{"camera": 0, "translation": [0.2, 0.3, DISTANCE]}]
    model.json["nodes"] += [{"mesh": 0, "translation": [-1.2, 0, -DISTANCE], "scale": [0.1, 0.1, 1]}]
    model.json["scenes"] = [{"nodes": [0, 1, 2]}]
    return model.read(MeshPose(camera="0"))


def project_as_specified(points: np.ndarray, camera: dict[str, dict[str, float]], aspect: float) -> np.ndarray:
    """Normalised device coordinates (x, y) by the matrices of glTF 2.0, section 3.10.3."""
    if "orthographic" in camera:
        return points[:, :2] / [camera["orthographic"]["xmag"], camera["orthographic"]["ymag"]]
    tangent = np.tan(0.5 * camera["perspective"]["yfov"])
    return points[:, :2] / [aspect * tangent, tangent] / -points[:, 2:]


@pytest.mark.parametrize(
    ("camera", "lenses", "width", "height"),
    [
        ({"perspective": {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}}, (40, 60), 60, 40),
        ({"perspective": {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1, "zfar": 100}}, (60, 60), 60, 40),
        ({"perspective": {"yfov": 0.7, "znear": 0.1}}, (40, 70), 70, 40),  # the shape of the view
        ({"orthographic": {"xmag": 2.4, "ymag": 1.2, "znear": 0.1, "zfar": 100}}, (60, 60), 60, 30),
    ],
)
def test_the_centre_view_is_the_cameras_picture_at_the_subjects_distance(
    camera: dict[str, dict[str, float]], lenses: tuple[int, int], width: int, height: int
) -> None:
    scene = film_square(camera)
    assert scene.window is not None
    assert scene.window.distance == pytest.approx(DISTANCE, rel=1e-5)  # Embree's float32
    array = LensArray(*lenses, 3, 3)
    (part,) = scene.transform(frame_scene(scene, array)).parts
    (filmed,) = scene.parts
    expected = project_as_specified(filmed.vertices, camera, width / height) * [width / 2, height / 2]
    depth = -filmed.vertices[:, 2:] / DISTANCE
    nearer = np.where(depth > 1, 1 if "orthographic" in camera else depth, 1)  # parallel rays don't shrink what is far
    assert part.vertices[:, :2] == pytest.approx(expected * nearer, rel=1e-5)


@pytest.mark.parametrize("place", [-1.0, 0.0, 1.0])
def test_what_a_camera_sees_is_placed_and_turned_about_the_subject(place: float) -> None:
    scene = film_square({"perspective": {"yfov": 0.7, "znear": 0.1}})
    array = LensArray(40, 40, 3, 3)
    (part,) = scene.transform(frame_scene(scene, array, Placement(place=place))).parts
    assert (np.sign(part.vertices[:, 2]) * (place or np.sign(part.vertices[:, 2])) > 0).all()
    plain, turned = (frame_scene(scene, array, Placement(place=place, rotate=(yaw, 0, 0))) for yaw in (0, 50))
    subject = np.array([0, 0, -scene.window.distance, 1])
    assert turned @ subject == pytest.approx(plain @ subject)
    zoomed = frame_scene(scene, array, Placement(place=place, zoom=2))
    assert zoomed[:3] == pytest.approx(2 * plain[:3])


def test_a_camera_that_sees_nothing_has_all_before_it_framed() -> None:
    scene = filmed_model().read(MeshPose(camera="Left"))  # the square edge-on
    assert scene.window is None
    assert scene.notes[-1] == "the camera's picture is empty: everything in front of it is framed"
