import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.gltf.skins import bend
from ciir.renderer.readers.meshes.pose import MeshPose
from tests.support.meshes.gltf import SQUARE, Model

HALF = float(np.sqrt(0.5))
JOINTS = np.array([[0, 1, 0, 0]] * 4, np.uint8)
WEIGHTS = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0, 2, 0, 0], [1, 1, 0, 0]], np.float32)


def skinned_model() -> Model:
    """The square on two joints: one at the origin, one at y = 1 above it, which turns about z by 90 degrees in 1 s."""
    model = Model(JOINTS_0=JOINTS, WEIGHTS_0=WEIGHTS, NORMAL=np.tile(np.array([0, 0, 1], np.float32), (4, 1)))
    inverse = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    inverse[1, 1, 3] = -1
    model.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": model.add(inverse.transpose(0, 2, 1))}]
    model.json["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [9, 9, 9]},  # has no effect: joints place a skinned mesh
        {"children": [2]},
        {"translation": [0, 1, 0]},
    ]
    model.json["scenes"] = [{"nodes": [0, 1]}]
    model.animate(2, "rotation", [0, 1], np.array([[0, 0, 0, 1], [0, 0, HALF, HALF]], np.float32))
    return model


def test_as_stored_the_skin_has_its_first_shape() -> None:
    assert skinned_model().read().parts[0].vertices == pytest.approx(SQUARE)


def test_a_pose_by_hand() -> None:
    (part,) = skinned_model().read(MeshPose(0.5)).parts
    # At half of the time joint 1 has turned by 45 degrees about (0, 1), on which the last corner lies.
    assert part.vertices == pytest.approx(np.array([[0, 0, 0], [1, 0, 0], [HALF, 1 + HALF, 0], [0, 1, 0]]), abs=1e-6)


def test_the_skeleton_places_the_mesh() -> None:
    model = skinned_model()
    model.json["nodes"][1] |= {"translation": [5, 0, 0], "scale": [2, 2, 2]}
    assert model.read().bounds() == pytest.approx(np.array([[5, 0, 0], [7, 2, 0]]))


def bend_slowly(
    vertices: np.ndarray, normals: np.ndarray, joints: np.ndarray, weights: np.ndarray, matrices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Each vertex and each normal by its own matrix."""
    moved, turned = [], []
    for vertex, normal, names, given_shares in zip(vertices, normals, joints, weights, strict=True):
        shares = given_shares / given_shares.sum() if given_shares.sum() > 0 else np.eye(len(names))[0]
        mean = sum(share * matrices[name] for name, share in zip(names, shares, strict=True))
        moved.append((mean @ [*vertex, 1])[:3])
        linear = mean[:3, :3]
        turned.append(np.linalg.inv(linear).T @ normal * abs(np.linalg.det(linear)))
    return np.array(moved), np.array(turned)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_any_skin_as_the_slow_reference_bends_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, normals = rng.normal(size=(2, 6, 3))
    joints, weights = rng.integers(0, 3, (6, 4)), rng.random((6, 4)) * rng.integers(0, 2, (6, 1))
    matrices = rng.normal(size=(3, 4, 4))
    matrices[:, 3] = 0, 0, 0, 1
    moved, turned, _ = bend(vertices, normals, joints, weights, matrices)
    expected = bend_slowly(vertices, normals, joints, weights, matrices)
    assert moved == pytest.approx(expected[0], abs=1e-9)
    assert turned == pytest.approx(expected[1], abs=1e-9)  # the inverse's rounding on nearly flat matrices


def test_a_mirrored_skeleton_keeps_outside_outside() -> None:
    model, plain = skinned_model(), skinned_model()
    del model.primitive["attributes"]["NORMAL"]
    model.json["nodes"][1]["scale"] = [-1, 1, 1]
    assert model.read().parts[0].colors == pytest.approx(plain.read().parts[0].colors)


def test_two_sets_of_joints() -> None:
    model = skinned_model()
    attributes = model.primitive["attributes"]
    attributes["JOINTS_1"] = model.add(np.full((4, 4), 1, np.uint16))
    attributes["WEIGHTS_1"] = model.add(np.array([[1, 0, 0, 0]] + [[0, 0, 0, 0]] * 3, np.float32))
    (part,) = model.read(MeshPose(1.0)).parts
    assert part.vertices[0] == pytest.approx([0.5, 0.5, 0], abs=1e-6)  # half of (0, 0) and half of (1, 1)


def test_skins_that_do_not_fit() -> None:
    model = skinned_model()
    model.primitive["attributes"]["JOINTS_0"] = model.add(JOINTS + np.uint8(1))
    with pytest.raises(Unreadable, match="names a joint that is not there"):
        model.read()
    model = skinned_model()
    model.json["accessors"][model.json["skins"][0]["inverseBindMatrices"]]["count"] = 1
    with pytest.raises(Unreadable, match="skin 0 lacks inverse bind matrices"):
        model.read()
    model = skinned_model()
    model.json["scenes"] = [{"nodes": [0]}]
    scene = model.read()
    assert scene.bounds().tolist() == [[9, 9, 9], [10, 10, 9]]
    assert scene.notes == ("a skin's joints are not in the scene: its mesh is drawn as it was modelled",)
