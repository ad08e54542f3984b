"""Writes models as GLB and PLY files whose colours are read back unchanged, without lighting.

A GLB's material has KHR_materials_unlit, and its vertex colours are linear, in float32, so that all 8 bits come back. A
PLY has no materials: the comment `unlit` in its header is ours, and other programs may light it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.readers.meshes.ply import UNLIT
from ciir.renderer.shading import decode_srgb

if TYPE_CHECKING:
    from ciir.renderer.focus.model.model import Model

FORMATS = (".glb", ".ply")


def encode_model(model: Model, suffix: str, *, points: bool = False) -> bytes:
    """Returns the bytes of a file that ends in `suffix`, one of `FORMATS`; with `points`, of the vertices alone, as
    PLY.

    Raises `InvalidOption` for other formats.
    """
    suffix = suffix.lower()
    if suffix not in FORMATS:
        raise InvalidOption(
            f"format: a model can't be a {suffix or 'file without a suffix'}; give {' or '.join(FORMATS)}"
        )
    if suffix == ".glb" and points:
        raise InvalidOption("format: points are written as PLY; give .ply")
    return _encode_glb(model) if suffix == ".glb" else _encode_ply(model, points=points)


def _encode_glb(model: Model) -> bytes:
    import trimesh

    # A separate attribute stays in float32; trimesh writes its own vertex colours in 8 bits.
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    mesh.vertex_attributes["_COLOR"] = decode_srgb(model.colors / 255)

    def finish(tree: dict[str, Any]) -> None:
        (primitive,) = tree["meshes"][0]["primitives"]
        primitive["attributes"]["COLOR_0"] = primitive["attributes"].pop("_COLOR")
        primitive["material"] = 0
        rough = {"metallicFactor": 0, "roughnessFactor": 1}
        tree["materials"] = [
            {"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": rough, "doubleSided": True}
        ]
        tree["extensionsUsed"] = ["KHR_materials_unlit"]

    data: bytes = trimesh.Scene(mesh).export(file_type="glb", tree_postprocessor=finish)
    return data


def _encode_ply(model: Model, *, points: bool) -> bytes:
    import trimesh

    cloud = trimesh.PointCloud(model.vertices, model.colors)
    mesh = trimesh.Trimesh(model.vertices, model.faces, vertex_colors=model.colors, process=False)
    data: Any = (cloud if points else mesh).export(file_type="ply")
    head, end, body = data.partition(b"end_header\n")
    return b"".join([head, UNLIT.encode(), b"\n", end, body])
