"""glTF primitives as surfaces (glTF 2.0, section 3.7)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.geometry import add_alpha, normalise
from ciir.renderer.readers.meshes.gltf.accessors import make_triangles, read_accessor
from ciir.renderer.readers.meshes.gltf.draco import decode_draco
from ciir.renderer.readers.meshes.gltf.materials import Material
from ciir.renderer.shading import encode_srgb
from ciir.renderer.surface import Surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document


def read_primitive(document: Document, primitive: dict[str, Any]) -> Surface | None:
    """The surface of a primitive in its mesh's coordinates; None for points and lines, with a note."""
    mode = primitive.get("mode", 4)
    if mode not in {4, 5, 6}:
        document.resolver.add_note("points and lines are left out: they have no surface")
        return None
    arrays: dict[str, NDArray[Any]] = {}
    compressed = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
    if compressed is not None:
        faces, arrays = decode_draco(document, compressed)
        for name in arrays:
            entry = document.item("accessors", primitive["attributes"][name])
            if entry.get("normalized"):
                arrays[name] = normalise(arrays[name])
    material = Material(document, primitive.get("material"))
    attributes = primitive["attributes"]
    wanted = [name for name in ("POSITION", "NORMAL", "COLOR_0", material.texcoord) if name in attributes]
    if len({document.item("accessors", attributes[name])["count"] for name in wanted}) > 1:
        raise Unreadable(f"{document.name}: a primitive's attributes differ in length; export it again")
    if "POSITION" not in arrays:
        arrays["POSITION"] = _stored(document, attributes["POSITION"], "positions")
    for name in wanted:
        if name not in arrays:
            arrays[name] = read_accessor(document, attributes[name])
    position = arrays["POSITION"].astype(np.float64).reshape(-1, 3)
    count = len(position)
    if compressed is None:
        indices = (
            _stored(document, primitive["indices"], "indices") if "indices" in primitive else np.arange(count)[:, None]
        )
        faces = make_triangles(indices, mode)
    if any(len(values) != count for values in arrays.values()):
        raise Unreadable(f"{document.name}: a primitive's attributes differ in length; export it again")
    color_0 = arrays.get("COLOR_0")
    texture, uv = material.texture(arrays)
    return Surface(
        vertices=position,
        faces=faces,
        normals=arrays["NORMAL"].astype(np.float64).reshape(-1, 3) if "NORMAL" in arrays else None,
        color=material.color,
        colors=None if color_0 is None else to_display_colors(color_0),
        uv=None if texture is None else uv,
        texture=texture,
        alpha_cutoff=material.alpha_cutoff,
        is_see_through=material.is_see_through,
        lit="KHR_materials_unlit" not in material.extensions,
    )


def _stored(document: Document, index: object, what: str) -> NDArray[Any]:
    """An accessor that has data: one without would be zeros, which make no surface."""
    if "bufferView" not in document.item("accessors", index):
        raise Unreadable(f"{document.name}: accessor {index}, of {what}, has no data; export it again")
    return read_accessor(document, index)


def to_display_colors(color_0: NDArray[Any]) -> NDArray[np.float32]:
    """Converts linear vertex colours `(n, 3 or 4)` to display-referred RGBA `(n, 4)`; alpha is kept."""
    values = normalise(color_0)
    rgba = add_alpha(encode_srgb(values[:, :3]))
    if values.shape[1] == 4:
        rgba[:, 3] = np.clip(values[:, 3], 0.0, 1.0)
    return rgba
