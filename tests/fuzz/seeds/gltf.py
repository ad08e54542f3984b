"""Small glTF files of every kind that is read, as seeds and as parts of larger ones."""

from __future__ import annotations

import base64
import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.writers.pictures import encode_png
from tests.fuzz.seeds import CORNERS, FACES, noise, pack

if TYPE_CHECKING:
    from collections.abc import Mapping


def document_of(uri: str | None, image: dict[str, Any]) -> dict[str, Any]:
    """A glTF document of one textured primitive with a sparse accessor, whose data is `stored()`."""
    buffer: dict[str, Any] = {"byteLength": len(stored())}
    if uri is not None:
        buffer["uri"] = uri
    views = [(0, 48), (48, 24), (72, 32), (104, 64), (168, 1), (172, 12)]
    return {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_texture_transform"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1, 2]}, {"mesh": 0, "rotation": [0, 0, 0, 1]}, {"mesh": 1, "scale": [-1, 1, 2]}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 2, "COLOR_0": 3}, "indices": 1, "material": 0}
                ]
            },
            {"primitives": [{"attributes": {"POSITION": 4}, "mode": 5}]},
        ],
        "materials": [
            {
                "alphaMode": "MASK",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [1, 0.5, 0.25, 1],
                    "baseColorTexture": {
                        "index": 0,
                        "extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.5}},
                    },
                },
            }
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}],
        "images": [image],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 3, "componentType": 5121, "count": 4, "type": "VEC4", "normalized": True},
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 4,
                "type": "VEC3",
                "sparse": {
                    "count": 1,
                    "indices": {"bufferView": 4, "componentType": 5121},
                    "values": {"bufferView": 5},
                },
            },
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in views],
        "buffers": [buffer],
    }


def stored() -> bytes:
    """Positions, indices, texture coordinates, colours, and what the sparse accessor puts in."""
    data = struct.pack("<12f", *(float(x) for corner in CORNERS for x in corner))
    data += struct.pack("<12H", *(i for face in FACES for i in face))
    data += struct.pack("<8f", 0, 0, 1, 0, 1, 1, 0, 1) + bytes(range(64))
    return data + struct.pack("<B3x3f", 1, 2.0, 0.0, 0.0)


def glb_of(document: Mapping[str, Any], binary: bytes) -> bytes:
    """A GLB of the two chunks."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf() -> list[bytes]:
    """With a buffer and a picture beside it, and with both inside."""
    picture = encode_png(noise(4, 4, 3))
    embedded = "data:application/octet-stream;base64," + base64.b64encode(stored()).decode()
    inside = {"uri": "data:image/png;base64," + base64.b64encode(picture).decode()}
    return [
        pack(json.dumps(document_of("a.bin", {"uri": "x.png"})).encode(), stored(), picture),
        json.dumps(document_of(embedded, inside)).encode(),
    ]


def glb() -> list[bytes]:
    """With its picture in a buffer view."""
    picture = encode_png(noise(4, 4, 3))
    document = document_of(None, {"bufferView": 6, "mimeType": "image/png"})
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(stored()), "byteLength": len(picture)})
    document["buffers"][0]["byteLength"] += len(picture)
    return [glb_of(document, stored() + picture)]


def draco() -> list[bytes]:
    """A GLB whose one primitive is compressed."""
    import DracoPy

    packed = DracoPy.encode(np.array(CORNERS, np.float32), np.array(FACES, np.uint32))
    document = {
        "asset": {"version": "2.0"},
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0},
                        "indices": 1,
                        "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}},
                    }
                ]
            }
        ],
        "accessors": [
            {"componentType": 5126, "count": 4, "type": "VEC3"},
            {"componentType": 5125, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": len(packed)}],
        "buffers": [{"byteLength": len(packed)}],
    }
    return [glb_of(document, packed)]
