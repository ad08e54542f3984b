import numpy as np
import pytest

from ciir.errors import InvalidGeometry, InvalidOption, Unreadable
from ciir.renderer.readers.meshes.pose import MeshPose
from tests.support.meshes import FRONT
from tests.support.meshes.gltf import SQUARE, Model

HALF = float(np.sqrt(0.5))


def filmed_model() -> Model:
    """The square with three cameras: as the array looks, from the left (along +x), and on its side."""
    model = Model()
    model.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}, {"name": "Close-up"}]
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
    assert scene.notes == ("camera 0: the lens array looks its way; its angle of view plays no part",)


@pytest.mark.parametrize("camera", ["1", "Left", "Close-up"])
def test_seen_from_the_left_by_number_and_by_either_name(camera: str) -> None:
    (part,) = filmed_model().read(MeshPose(camera=camera)).parts
    x, y, _ = SQUARE.T
    # The camera at x = -1 looks along +x: +z is to its right, and what is far from it lies at large x.
    assert part.vertices == pytest.approx(np.stack([0 * x, y, -1 - x], axis=1), abs=1e-6)


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
    assert scene.notes[1] == "2 triangles lie behind the camera and are left out"
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
    with pytest.raises(InvalidOption, match=r"camera: 'Rear' is none of a\.glb's; give 0, 1 \(Left\), 2 \(1\)$"):
        filmed_model().read(MeshPose(camera="Rear"))
    with pytest.raises(InvalidOption, match=r"camera: a\.glb holds no camera; leave it out"):
        Model().read(MeshPose(camera="0"))
    model = filmed_model()
    model.json["nodes"][1]["scale"] = [1, 1, 0]
    with pytest.raises(Unreadable, match="camera 0 has no orientation"):
        model.read(MeshPose(camera="0"))
