import numpy as np
import pytest

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.gltf.document import Document
from ciir.renderer.readers.meshes.gltf.scene import find_surfaces
from ciir.renderer.readers.meshes.pose import MeshPose
from ciir.renderer.readers.meshes.texture_files import Resolver
from ciir.renderer.shading import shade
from tests.support.meshes.gltf import SQUARE, UV, Model

UPWARD = np.tile(np.array([0, 0, 2], np.float32), (4, 1))
FRONTAL = np.tile(np.array([0, 0, 1], np.float32), (4, 1))


def morphed_model(**weights: list[float]) -> Model:
    """The square with two targets: all corners lifted by 2, and, as a sparse accessor, the last corner to x = 3."""
    model = Model(NORMAL=FRONTAL)
    sparse = {
        "count": 1,
        "indices": {"bufferView": model.view(b"\3"), "componentType": 5121},
        "values": {"bufferView": model.view(np.array([3, 0, 0], np.float32).tobytes())},
    }
    model.json["accessors"].append({"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse})
    last = len(model.json["accessors"]) - 1
    model.primitive["targets"] = [
        {"POSITION": model.add(UPWARD), "NORMAL": model.add(np.tile(np.array([0, 1, 0], np.float32), (4, 1)))},
        {"POSITION": last},
    ]
    model.json["meshes"][0] |= weights
    return model


def test_without_weights_targets_are_not_even_read() -> None:
    model = morphed_model(weights=[0, 0])
    model.primitive["targets"][0]["POSITION"] = 99
    assert np.array_equal(model.read().parts[0].vertices, SQUARE)


def test_weights_of_the_mesh_of_a_node_and_of_an_animation() -> None:
    model = morphed_model(weights=[0.5, 1])
    moved = SQUARE + np.array([[0, 0, 1]] * 3 + [[3, 0, 1]])
    assert model.read().parts[0].vertices == pytest.approx(moved)
    model.json["nodes"][0]["weights"] = [0.25, 0]
    assert model.read().parts[0].vertices == pytest.approx(SQUARE + 0.25 * UPWARD)
    model.animate(0, "weights", [0, 1], np.array([0, 0, 1, 0], np.float32))
    assert model.read(MeshPose(0.75)).parts[0].vertices == pytest.approx(SQUARE + 0.75 * UPWARD)


def test_a_spline_of_weights_has_tangents_of_all_targets_together() -> None:
    model = morphed_model()
    keys = [[0, 0], [0.5, 0], [0, 0], [0, 0], [0.5, 1], [0, 0]]  # in-tangent, value, out-tangent, of both targets
    model.animate(0, "weights", [0, 1], np.array(keys, np.float32).ravel(), "CUBICSPLINE")
    moved = SQUARE + np.array([[0, 0, 1]] * 3 + [[1.5, 0, 1]])
    assert model.read(MeshPose(0.5)).parts[0].vertices == pytest.approx(moved)


def test_normals_are_morphed() -> None:
    (part,) = morphed_model(weights=[1]).read().parts
    normal = np.array([[0, 1, 1]]) / np.sqrt(2)
    assert part.colors[:, 0] == pytest.approx(np.full(4, shade(normal)[0]), abs=1e-6)


def test_two_nodes_with_weights_of_their_own_share_a_mesh() -> None:
    model = morphed_model(weights=[1])
    model.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "weights": [0]}, {"mesh": 0, "translation": [0, 0, 7]}]
    model.json["scenes"] = [{"nodes": [0, 1, 2]}]
    heights = {float(z) for part in model.read().parts for z in part.vertices[:, 2]}
    assert heights == {2, 0, 9}


def test_targets_that_do_not_fit_or_are_not_drawn() -> None:
    model = morphed_model(weights=[1])
    model.primitive["targets"][0]["COLOR_0"] = 99
    assert model.read().notes == ("morph targets of colours and texture coordinates are left out",)
    model.primitive["targets"][0]["POSITION"] = model.add(UPWARD[:3])
    with pytest.raises(Unreadable, match="a morph target differs in length from its mesh"):
        model.read()


def test_a_meshs_weights_are_looked_at_once() -> None:
    class Weights(list[float]):
        looks = 0

        def __iter__(self):  # type: ignore[no-untyped-def]
            Weights.looks += 1
            return super().__iter__()

    mesh = {"weights": Weights([0.0, 0.5]), "primitives": []}
    document = Document("a", {"meshes": [mesh], "nodes": [{"mesh": 0}] * 20}, None, Resolver({}, "a"), 100)
    assert list(find_surfaces(document, {}, np.eye(4))) == []
    assert Weights.looks == 1


@pytest.mark.parametrize("name", ["POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0"])
def test_attributes_of_a_wrong_width(name: str) -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.primitive["attributes"][name] = model.add(np.ones((4, 1), np.float32))
    with pytest.raises(Unreadable, match=f"{name} has 1 numbers a vertex; export it again"):
        model.read()
