import numpy as np
import pytest

from ciir.errors import InvalidGeometry, TooLarge, Unreadable
from ciir.renderer.readers.meshes.gltf import scene as gltf_scene
from ciir.renderer.readers.meshes.gltf.nodes import local_matrix
from ciir.renderer.shading import shade
from tests.support.meshes import FRONT
from tests.support.meshes.gltf import SQUARE, Model


def test_nodes_place_vertices_and_normals() -> None:
    normals = np.tile(np.array([0, 0.6, 0.8], np.float32), (4, 1))
    model = Model(NORMAL=normals)
    half = np.sqrt(0.5)
    model.json["nodes"] = [
        {"children": [1], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": [0, half, 0, half], "scale": [1, 2, 1]},  # a quarter turn: z goes to x
    ]
    (part,) = model.read().parts
    expected = np.stack([10 + SQUARE[:, 2], 2 * SQUARE[:, 1], -SQUARE[:, 0]], 1)
    assert part.vertices == pytest.approx(expected, abs=1e-6)
    normal = np.array([[0.8, 0.3, 0.0]]) / np.hypot(0.8, 0.3)  # inverse transpose: stretched in y, flatter in y
    assert part.colors[:, 0] == pytest.approx(np.full(4, shade(normal)[0]), abs=1e-6)


def test_a_mirror_keeps_outside_outside() -> None:
    for attributes in ({}, {"NORMAL": np.tile(np.array([0, 0, 1], np.float32), (4, 1))}):
        model = Model(**attributes)
        model.json["nodes"] = [{"mesh": 0, "scale": [-1, 1, 1]}]
        (part,) = model.read().parts
        assert part.colors[:, 0] == pytest.approx(FRONT)
        a, b, c = part.vertices[part.faces[0]]
        assert np.cross(b - a, c - a)[2] > 0


def test_a_node_as_a_matrix_is_column_major() -> None:
    matrix = local_matrix({"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]})
    assert matrix[:3, 3].tolist() == [5, 6, 7]
    assert local_matrix({}).tolist() == np.eye(4).tolist()


def test_a_mesh_may_be_placed_twice() -> None:
    model = Model()
    model.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}]
    model.json["scenes"] = [{"nodes": [0, 1]}]
    scene = model.read()
    assert scene.triangles == 4
    assert scene.bounds().tolist() == [[0, 0, 0], [1, 1, 5]]


def test_of_several_scenes_the_default_is_drawn_with_a_note() -> None:
    model = Model()
    model.json["nodes"].append({"mesh": 0, "translation": [3, 0, 0]})
    model.json.update(scenes=[{"nodes": [0]}, {"nodes": [1], "name": "Far"}], scene=1)
    scene = model.read()
    assert scene.parts[0].vertices[:, 0].min() == 3
    assert scene.notes == ("of 2 scenes only the file's default, Far, is drawn",)


def test_an_empty_list_of_scenes_counts_as_none() -> None:
    model = Model()
    model.json["scenes"] = []
    assert model.read().triangles == 2


def test_hidden_nodes_are_left_out_with_those_below_them() -> None:
    model = Model()
    hidden = {"KHR_node_visibility": {"visible": False}}
    model.json["extensionsUsed"] = ["KHR_node_visibility"]
    model.json["nodes"] += [{"mesh": 0, "extensions": hidden, "children": [2]}, {"mesh": 0}]
    model.json["scenes"] = [{"nodes": [0, 1]}]
    scene = model.read()
    assert (scene.triangles, scene.notes) == (2, ())


def test_without_scenes_all_roots_are_drawn() -> None:
    model = Model()
    del model.json["scenes"], model.json["scene"]
    model.json["nodes"] = [{"children": [1]}, {"mesh": 0}]
    assert model.read().triangles == 2


def test_primitives_without_a_surface_are_counted_too(monkeypatch: pytest.MonkeyPatch) -> None:
    model = Model()
    model.json["meshes"].append({"primitives": [{"mode": 0}] * 30})
    model.json["nodes"] = [{"mesh": 0}] + [{"mesh": 1}] * 10
    model.json["scenes"] = [{"nodes": list(range(11))}]
    assert model.read().notes == ("points and lines are left out: they have no surface",)
    monkeypatch.setattr(gltf_scene, "MAX_PRIMITIVES", 300)
    with pytest.raises(TooLarge, match="over 300 primitives in its nodes"):
        model.read()


def test_a_mesh_that_is_repeated_without_end() -> None:
    model = Model()
    model.json["nodes"] = [{"mesh": 0}] * 50
    model.json["scenes"] = [{"nodes": list(range(50))}]
    with pytest.raises(TooLarge, match="100 triangles and 200 vertices in 50 copies; at most 180 and 180 are read"):
        model.read(triangles=60)


TRANSLATIONS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], np.float32)
ROTATIONS = np.array([[0, 0, 0, 32767], [0, 0, 32767, 0], [0, 23170, 0, 23170]], np.int16)
SCALES = np.array([[1, 1, 1], [2, 2, 2], [1, -1, 1]], np.float32)


def instanced_model(**attributes: int) -> Model:
    model = Model()
    model.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    model.json["nodes"] = [
        {"translation": [0, 0, 1], "mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    ]
    return model


def test_instances_are_as_many_nodes() -> None:
    model = instanced_model()
    attributes = model.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    attributes["TRANSLATION"] = model.add(TRANSLATIONS)
    attributes["ROTATION"] = model.add(ROTATIONS, normalized=True)
    attributes["SCALE"] = model.add(SCALES)
    plain = Model()
    plain.json["nodes"] = [{"translation": [0, 0, 1], "children": [1, 2, 3]}] + [
        {"mesh": 0, "translation": t.tolist(), "rotation": r.tolist(), "scale": s.tolist()}
        for t, r, s in zip(TRANSLATIONS, ROTATIONS / 32767, SCALES, strict=True)
    ]
    (found,), (expected,) = model.read().parts, plain.read().parts
    assert found.vertices == pytest.approx(expected.vertices, abs=1e-6)  # the rotations' float32
    assert np.array_equal(found.faces, expected.faces)
    assert found.colors == pytest.approx(expected.colors, abs=1e-6)


def test_instances_without_some_attributes() -> None:
    model = instanced_model()
    attributes = model.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    attributes["TRANSLATION"] = model.add(TRANSLATIONS)
    attributes["_ID"] = 99
    assert model.read().bounds().tolist() == [[0, 0, 1], [3, 4, 1]]


def test_instances_that_differ_in_length_or_are_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    model = instanced_model()
    attributes = model.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    with pytest.raises(Unreadable, match="instances differ in length"):
        model.read()
    attributes["TRANSLATION"], attributes["SCALE"] = model.add(TRANSLATIONS), model.add(SCALES[:2])
    with pytest.raises(Unreadable, match="instances differ in length"):
        model.read()
    del attributes["SCALE"]
    monkeypatch.setattr(gltf_scene, "MAX_PRIMITIVES", 2)
    with pytest.raises(TooLarge, match="a node with 3 instances; at most 2 are read"):
        model.read()


def test_an_instance_without_extent_is_left_out() -> None:
    model = instanced_model()
    attributes = model.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    attributes["SCALE"] = model.add(np.array([[0, 0, 0], [2, 2, 2], [1, 0, 0]], np.float32))
    assert model.read().triangles == 2
    attributes["SCALE"] = model.add(np.zeros((3, 3), np.float32))
    with pytest.raises(InvalidGeometry, match="all its copies have zero area"):
        model.read()
