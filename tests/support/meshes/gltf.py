"""A small glTF file that tests change."""

import json
import struct
from typing import Any

import numpy as np

from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose
from ciir.renderer.scene import Scene
from ciir.renderer.writers.pictures import encode_png
from tests.support.meshes import read_mesh

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
INDICES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # glTF's v goes down: the first pixel row is at y = 1
PIXELS = np.array([[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [255, 255, 255, 0]]], np.uint8)
CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Model:
    """One square of one material, as JSON that a test may change, and its bytes."""

    def __init__(self, **attributes: np.ndarray) -> None:
        self.binary = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}],
            "materials": [{}],
            "bufferViews": [],
            "accessors": [],
            "buffers": [{}],
        }
        self.primitive = self.json["meshes"][0]["primitives"][0]
        self.primitive["indices"] = self.add(INDICES)
        self.primitive["material"] = 0
        self.material = self.json["materials"][0]
        for name, values in ({"POSITION": SQUARE} | attributes).items():
            self.primitive["attributes"][name] = self.add(values)

    def view(self, data: bytes) -> int:
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data + bytes(-len(data) % 4)
        return len(self.json["bufferViews"]) - 1

    def add(self, values: np.ndarray, **more: object) -> int:
        values = values.reshape(len(values), -1)
        self.json["accessors"].append(
            {
                "bufferView": self.view(values.tobytes()),
                "componentType": CODES[values.dtype.str[1:]],
                "count": len(values),
                "type": TYPES[values.shape[1]],
                **more,
            }
        )
        return len(self.json["accessors"]) - 1

    def texture(self, pixels: np.ndarray = PIXELS, **sampler: int) -> "Model":
        self.json["images"] = [{"bufferView": self.view(encode_png(pixels)), "mimeType": "image/png"}]
        self.json["samplers"] = [sampler]
        self.json["textures"] = [{"source": 0, "sampler": 0}]
        self.material["pbrMetallicRoughness"] = {"baseColorTexture": {"index": 0}}
        return self

    def animate(self, node: int, path: str, times: list[float], values: np.ndarray, mode: str = "LINEAR") -> None:
        """Adds a channel to the last animation."""
        animation = self.json.setdefault("animations", [{"channels": [], "samplers": []}])[-1]
        sampler = {"input": self.add(np.array(times, np.float32)), "output": self.add(values), "interpolation": mode}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": {"node": node, "path": path}})
        animation["samplers"].append(sampler)

    def glb(self) -> bytes:
        self.json["buffers"][0]["byteLength"] = len(self.binary)
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def gltf(self, uri: str) -> bytes:
        self.json["buffers"][0] = {"byteLength": len(self.binary), "uri": uri}
        return json.dumps(self.json).encode()

    def read(self, pose: MeshPose = AS_STORED, **limits: int) -> Scene:
        return read_mesh(".glb", self.glb(), pose=pose, **limits)
