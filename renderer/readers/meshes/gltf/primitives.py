"""glTF primitives as surfaces (glTF 2.0, section 3.7; KHR_draco_mesh_compression)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.geometry import add_alpha, normalise
from ciir.renderer.readers.meshes.gltf.accessors import make_triangles, read_accessor
from ciir.renderer.readers.meshes.gltf.materials import Material
from ciir.renderer.readers.meshes.gltf.skins import bend
from ciir.renderer.shading import FLAT, encode_srgb
from ciir.renderer.surface import Surface

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

_WIDTHS = {"POSITION": (3,), "NORMAL": (3,), "COLOR": (3, 4), "TEXCOORD": (2,)}
"""The numbers for each vertex that an attribute may have. Joints and weights have 4."""


def read_primitive(
    document: Document,
    primitive: dict[str, Any],
    weights: Sequence[tuple[int, float]],
    joints: NDArray[np.float64] | None,
) -> Surface | None:
    """Reads the surface of a primitive in its mesh's coordinates. Returns None, with a note, for points and lines.

    `weights` holds the indices of morph targets and their weights. `joints` holds the matrices of the skin's joints
    `(m, 4, 4)`, which transform the surface to the scene's coordinates.
    """
    mode = primitive.get("mode", 4)
    if mode not in {4, 5, 6}:
        document.resolver.add_note("points and lines are left out: they have no surface")
        return None
    material = Material(document, primitive.get("material"))
    bent_by = [] if joints is None else [n for n in primitive["attributes"] if n.startswith(("JOINTS_", "WEIGHTS_"))]
    wanted = ["POSITION", "NORMAL", "COLOR_0", material.texcoord, *bent_by]
    arrays, faces = _read_arrays(document, primitive, wanted, mode)
    color_0 = arrays.get("COLOR_0")
    texture, uv = material.texture(arrays)
    vertices = arrays["POSITION"].astype(np.float64).reshape(-1, 3)
    normals = arrays["NORMAL"].astype(np.float64).reshape(-1, 3) if "NORMAL" in arrays else None
    targets = primitive.get("targets", [])
    for target, weight in weights:
        if target < len(targets):
            vertices, normals = _morph(document, targets[target], weight, vertices, normals)
    if joints is not None and bent_by:
        sets = sorted(name.removeprefix("JOINTS_") for name in bent_by if name.startswith("JOINTS_"))
        vertices, normals, is_mirrored = bend(
            vertices,
            normals,
            np.concatenate([arrays[f"JOINTS_{of_set}"] for of_set in sets], axis=1),
            np.concatenate([arrays[f"WEIGHTS_{of_set}"] for of_set in sets], axis=1),
            joints,
        )
        faces = faces[:, ::-1] if is_mirrored else faces
    return Surface(
        vertices=vertices,
        faces=faces,
        normals=normals,
        crease=FLAT,
        color=material.color,
        colors=None if color_0 is None or material.only_emits else to_display_colors(color_0),
        uv=None if texture is None else uv,
        texture=texture,
        alpha_cutoff=material.alpha_cutoff,
        is_see_through=material.is_see_through,
        lit=not material.is_unlit,
        back=material.back,
        is_interpolated_linearly=color_0 is not None and not material.only_emits,
    )


def _read_arrays(
    document: Document, primitive: dict[str, Any], wanted: Sequence[str], mode: int
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Reads the `wanted` attributes that exist, and the faces `(m, 3)`. Draco data also gives other attributes."""
    arrays: dict[str, NDArray[Any]] = {}
    attributes = primitive["attributes"]
    compressed = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
    if compressed is not None:
        faces, arrays = _decode_draco(document, compressed)
        for name in arrays:
            entry = document.item("accessors", attributes[name])
            if entry.get("normalized"):
                arrays[name] = normalise(arrays[name])
    given = [name for name in wanted if name in attributes]
    if len({document.item("accessors", attributes[name])["count"] for name in given}) > 1:
        raise Unreadable(f"{document.name}: a primitive's attributes differ in length; export it again")
    if "POSITION" not in arrays:
        arrays["POSITION"] = _stored(document, attributes["POSITION"], "positions")
    for name in given:
        if name not in arrays:
            arrays[name] = read_accessor(document, attributes[name])
    count = len(arrays["POSITION"])
    if compressed is None:
        indices = (
            _stored(document, primitive["indices"], "indices") if "indices" in primitive else np.arange(count)[:, None]
        )
        faces = make_triangles(indices, mode)
    if any(len(values) != count for values in arrays.values()):
        raise Unreadable(f"{document.name}: a primitive's attributes differ in length; export it again")
    for name in given:
        if arrays[name].shape[1] not in _WIDTHS.get(name.partition("_")[0], (4,)):
            raise Unreadable(f"{document.name}: {name} has {arrays[name].shape[1]} numbers a vertex; export it again")
    return arrays, faces


def _decode_draco(document: Document, extension: dict[str, Any]) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
    """Decodes a Draco-compressed primitive: faces `(m, 3)`, and `(n, width)` for each attribute that it compresses."""
    import DracoPy

    try:
        mesh = DracoPy.decode(bytes(document.view(extension["bufferView"])))
    except (DracoPy.FileTypeException, RuntimeError, ValueError) as error:
        raise Unreadable(f"{document.name}: its Draco data is corrupt; export it again") from error
    stored = {entry["unique_id"]: np.asarray(entry["data"]) for entry in mesh.attributes}
    if getattr(mesh, "faces", None) is None:
        raise Unreadable(f"{document.name}: its Draco data holds only points; give a mesh with a surface")
    faces = np.asarray(mesh.faces).astype(np.int64).reshape(-1, 3)
    return faces, {str(name): stored[unique] for name, unique in extension["attributes"].items()}


def _morph(
    document: Document,
    target: dict[str, Any],
    weight: float,
    vertices: NDArray[np.float64],
    normals: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Adds `weight` times the differences of a morph target to vertices and normals `(n, 3)` (section 3.7.2.2)."""
    if any(name.startswith(("COLOR_", "TEXCOORD_")) for name in target):
        document.resolver.add_note("morph targets of colours and texture coordinates are left out")
    if "POSITION" in target:
        vertices = vertices + weight * _read_differences(document, target["POSITION"], len(vertices))
    if "NORMAL" in target and normals is not None:
        normals = normals + weight * _read_differences(document, target["NORMAL"], len(normals))
    return vertices, normals


def _read_differences(document: Document, index: object, count: int) -> NDArray[np.float64]:
    if document.item("accessors", index)["count"] != count:
        raise Unreadable(f"{document.name}: a morph target differs in length from its mesh; export it again")
    return read_accessor(document, index).astype(np.float64).reshape(-1, 3)


def _stored(document: Document, index: object, what: str) -> NDArray[Any]:
    """Reads an accessor that must have data: without data it would be zeros, which make no surface."""
    entry = document.item("accessors", index)
    if "bufferView" not in entry and "sparse" not in entry:
        raise Unreadable(f"{document.name}: accessor {index}, of {what}, has no data; export it again")
    return read_accessor(document, index)


def to_display_colors(color_0: NDArray[Any]) -> NDArray[np.float32]:
    """Converts linear vertex colours `(n, 3 or 4)` to display-referred RGBA `(n, 4)`; alpha is kept."""
    values = normalise(color_0)
    rgba = add_alpha(encode_srgb(values[:, :3]))
    if values.shape[1] == 4:
        rgba[:, 3] = np.clip(values[:, 3], 0.0, 1.0)
    return rgba
