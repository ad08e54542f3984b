"""Small glTF files of the extensions, animations, skins and cameras that are read."""

from __future__ import annotations

from functools import cache

import imagecodecs
import numpy as np

from tests.fuzz.seeds import pack, webps
from tests.support.meshes.gltf import INDICES, SQUARE, UV, Model
from tests.support.meshes.ktx2 import ETC1S, UASTC

TRIANGLES = bytes.fromhex("e1f000" + "007687566778a9866589689801690000")
"""The square's two triangles as meshoptimizer packs them: three new corners, then an edge and a new corner."""


def pose() -> list[bytes]:
    """Skins, morph targets, each kind of keyframes, instances and a camera; as `a.gltf` and its `a.bin`."""
    return [pack(model.gltf("a.bin"), model.binary) for model in (_skinned(), _morphed(), _instanced())]


@cache
def documents() -> list[tuple[bytes, bytes]]:
    """All files of this module, as `a.gltf` and its `a.bin`."""
    models = [_skinned(), _morphed(), _instanced(), *_list_packed(), *_list_textured(), *_list_painted()]
    return [(model.gltf("a.bin"), model.binary) for model in models]


def value_edits() -> list[bytes]:
    """An edit of each of `documents`, which leaves it readable."""
    return [bytes([number, 0, 1, 5]) for number in range(len(documents()))]


def _skinned() -> Model:
    joints = np.array([[0, 1, 0, 0]] * 4, np.uint8)
    model = Model(JOINTS_0=joints, WEIGHTS_0=np.array([[1, 1, 0, 0]] * 4, np.float32))
    inverse = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    model.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": model.add(inverse)}]
    model.json["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}]
    model.json["scenes"] = [{"nodes": [0, 1]}]
    model.animate(2, "rotation", [0, 1], np.array([[0, 0, 0, 1], [0, 0, 0.6, 0.8]], np.float32))
    model.animate(1, "scale", [0, 1], np.array([[1, 1, 1], [2, 2, 2]], np.float32), "STEP")
    return _film(model, 2)


def _morphed() -> Model:
    model = Model()
    model.primitive["targets"] = [{"POSITION": model.add(SQUARE + np.float32(1))}]
    model.json["meshes"][0]["weights"] = [0.5]
    model.animate(0, "weights", [0, 1], np.arange(6, dtype=np.float32), "CUBICSPLINE")
    return _film(model, 0)


def _instanced() -> Model:
    model = Model()
    attributes = {
        "TRANSLATION": model.add(np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], np.float32)),
        "ROTATION": model.add(np.array([[0, 0, 0, 127], [0, 0, 127, 0], [90, 0, 0, 90]], np.int8), normalized=True),
    }
    model.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    model.animate(0, "translation", [0, 1], np.zeros((2, 3), np.float32))
    return _film(model, 0)


def _film(model: Model, node: int) -> Model:
    """With a camera before the node."""
    model.json["cameras"] = [{"name": "Front", "type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]
    model.json["nodes"].append({"camera": 0, "translation": [0, 0, 5]})
    model.json["nodes"][node]["children"] = [len(model.json["nodes"]) - 1]
    return model


def packed() -> list[bytes]:
    """Buffer views of each mode of meshopt, with and without filters."""
    return [model.glb() for model in _list_packed()]


def _list_packed() -> list[Model]:
    return [_pack({}), _pack({"NORMAL": "OCTAHEDRAL", "POSITION": "EXPONENTIAL"})]


def _pack(filters: dict[str, str]) -> Model:
    normals = np.array([[0, 0, 127, 127]] * 4, np.int8)
    # Small integers are mantissas with an exponent of 0.
    positions = SQUARE.astype(np.int32) if "POSITION" in filters else SQUARE
    model = Model()
    for name, values in {"POSITION": positions, "NORMAL": normals}.items():
        stored = np.ascontiguousarray(values).view(np.uint8).reshape(4, -1)
        view = _add_packed(model, imagecodecs.meshopt_encode(stored), stored.shape[1], 4, "ATTRIBUTES")
        model.json["bufferViews"][view]["extensions"]["EXT_meshopt_compression"]["filter"] = filters.get(name, "NONE")
        model.json["accessors"].append(
            {
                "bufferView": view,
                "componentType": 5126 if name == "POSITION" else 5120,
                "count": 4,
                "type": "VEC3",
                "normalized": name == "NORMAL",
            }
        )
        model.primitive["attributes"][name] = len(model.json["accessors"]) - 1
    stream, mode = (TRIANGLES, "TRIANGLES") if filters else (bytes([0xD1, 0, 4, 4, 6, 8, 4]) + bytes(4), "INDICES")
    view = _add_packed(model, stream, 2, len(INDICES), mode)
    model.json["accessors"].append({"bufferView": view, "componentType": 5123, "count": 6, "type": "SCALAR"})
    model.primitive["indices"] = len(model.json["accessors"]) - 1
    return model


def _add_packed(model: Model, data: bytes, stride: int, count: int, mode: str) -> int:
    source = model.json["bufferViews"][model.view(data)]
    packed_view = {**source, "byteStride": stride, "count": count, "mode": mode}
    model.json["bufferViews"].append(
        {
            "buffer": 0,
            "byteLength": stride * count,
            **({"byteStride": stride} if mode == "ATTRIBUTES" else {}),
            "extensions": {"EXT_meshopt_compression": packed_view},
        }
    )
    return len(model.json["bufferViews"]) - 1


def textured() -> list[bytes]:
    """A WebP and a KTX2 texture."""
    return [model.glb() for model in _list_textured()]


def _list_textured() -> list[Model]:
    made = []
    for extension, data in (("EXT_texture_webp", webps()[0]), ("KHR_texture_basisu", UASTC)):
        model = Model(TEXCOORD_0=UV).texture()
        model.json["images"] = [{"bufferView": model.view(data)}]
        model.json["textures"] = [{"extensions": {extension: {"source": 0}}}]
        made.append(model)
    return made


def _list_painted() -> list[Model]:
    """A material whose specular colour counts, and one that is black but for the light that it emits."""
    metal, lamp = Model(), Model(TEXCOORD_0=UV).texture(np.zeros((2, 2, 3), np.uint8))
    values = {"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.8, 0.3]}
    metal.material["extensions"] = {"KHR_materials_pbrSpecularGlossiness": values}
    lamp.material.update(emissiveFactor=[1, 0.5, 0], emissiveTexture={"index": 0}, alphaMode="MASK")
    lamp.material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}
    return [metal, lamp]


def ktx2() -> list[bytes]:
    """Both codecs of Basis Universal."""
    return [ETC1S, UASTC]
