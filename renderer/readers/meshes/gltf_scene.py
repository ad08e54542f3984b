"""Reads a glTF file's nodes, primitives and materials as surfaces (Khronos glTF 2.0, sections 3.5 to 3.9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes import gltf, gltf_arrays
from ciir.renderer.readers.meshes.geometry import MAX_NODES, add_alpha, normalise, place_surfaces
from ciir.renderer.shading import encode_srgb
from ciir.renderer.surface import Surface

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.gltf import Document
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.scene import Texture, Wrap

_WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
_BLEND_CUTOFF = 0.5
MAX_PRIMITIVES = 200_000
"""Most primitives in all nodes together: many nodes can share one mesh of many primitives."""


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """All triangles of a `.glb` or `.gltf` file's scene in its world coordinates, material by material.

    Raises what `gltf.parse` does; `Unreadable` for references to nothing; `TooLarge` over `limits`, `MAX_NODES` or
    `MAX_PRIMITIVES`; an error of Python's where the JSON does not have the shape of glTF.
    """
    document = gltf.parse(data, name=name, resolver=resolver, max_triangles=limits.triangles)
    return place_surfaces(find_surfaces(document), name=name, max_triangles=limits.triangles, max_parts=MAX_PRIMITIVES)


def find_surfaces(document: Document) -> Iterator[tuple[Surface, NDArray[np.float64]]]:
    """The surfaces of the document's scene, each with its world matrix; raises as `read` does."""
    primitives: dict[tuple[int, int], Surface | None] = {}
    seen: set[int] = set()
    placed = 0
    for node, matrix in _nodes(document):
        if "mesh" not in node:
            continue
        mesh = document.item("meshes", node["mesh"])
        _note_unsupported(document, node, {} if node["mesh"] in seen else mesh)
        seen.add(node["mesh"])
        placed += len(mesh["primitives"])
        if placed > MAX_PRIMITIVES:
            raise TooLarge(
                f"{document.name}: over {MAX_PRIMITIVES:,} primitives in its nodes, which is the most that is read; "
                "join them"
            )
        for number, primitive in enumerate(mesh["primitives"]):
            key = node["mesh"], number
            if key not in primitives:
                primitives[key] = _primitive(document, primitive)
            surface = primitives[key]
            if surface is not None:
                yield surface, matrix


def _nodes(document: Document) -> Iterator[tuple[dict[str, Any], NDArray[np.float64]]]:
    """Each node of the scene with its world matrix, parents first."""
    if "scenes" in document.json:
        roots = document.item("scenes", document.json.get("scene", 0)).get("nodes", [])
    else:
        nodes = document.json.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in children]
    waiting = [(index, np.eye(4)) for index in reversed(roots)]
    seen: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        node = document.item("nodes", index)
        if index in seen:
            raise Unreadable(f"{document.name}: node {index} has two parents or is its own; export it again")
        seen.add(index)
        if len(seen) > MAX_NODES:
            raise TooLarge(f"{document.name}: over {MAX_NODES:,} nodes, which is the most that is read; join them")
        matrix = parent @ local_matrix(node)
        yield node, matrix
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]


def local_matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """A node's own 4x4 matrix: from the file (column-major), or translation x rotation x scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    length = x * x + y * y + z * z + w * w
    s = 2.0 / length if length > 0 else 0.0
    rotation = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _primitive(document: Document, primitive: dict[str, Any]) -> Surface | None:
    mode = primitive.get("mode", 4)
    if mode not in {4, 5, 6}:
        document.resolver.add_note("points and lines are left out: they have no surface")
        return None
    arrays: dict[str, NDArray[Any]] = {}
    compressed = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
    if compressed is not None:
        faces, arrays = gltf_arrays.decode_draco(document, compressed)
        for name in arrays:
            entry = document.item("accessors", primitive["attributes"][name])
            if entry.get("normalized"):
                arrays[name] = normalise(arrays[name])
    material = _Material(document, primitive.get("material"))
    attributes = primitive["attributes"]
    wanted = [name for name in ("POSITION", "NORMAL", "COLOR_0", material.texcoord) if name in attributes]
    if len({document.item("accessors", attributes[name])["count"] for name in wanted}) > 1:
        raise Unreadable(f"{document.name}: a primitive's attributes differ in length; export it again")
    if "POSITION" not in arrays:
        arrays["POSITION"] = _stored(document, attributes["POSITION"], "positions")
    for name in wanted:
        if name not in arrays:
            arrays[name] = gltf_arrays.read_accessor(document, attributes[name])
    position = arrays["POSITION"].astype(np.float64).reshape(-1, 3)
    count = len(position)
    if compressed is None:
        indices = (
            _stored(document, primitive["indices"], "indices") if "indices" in primitive else np.arange(count)[:, None]
        )
        faces = gltf_arrays.make_triangles(indices, mode)
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
        lit="KHR_materials_unlit" not in material.extensions,
    )


def _stored(document: Document, index: object, what: str) -> NDArray[Any]:
    """An accessor that has data: one without would be zeros, which make no surface."""
    if "bufferView" not in document.item("accessors", index):
        raise Unreadable(f"{document.name}: accessor {index}, of {what}, has no data; export it again")
    return gltf_arrays.read_accessor(document, index)


def to_display_colors(color_0: NDArray[Any]) -> NDArray[np.float32]:
    """Converts linear vertex colours `(n, 3 or 4)` to display-referred RGBA `(n, 4)`; alpha is kept."""
    values = normalise(color_0)
    rgba = add_alpha(encode_srgb(values[:, :3]))
    if values.shape[1] == 4:
        rgba[:, 3] = np.clip(values[:, 3], 0.0, 1.0)
    return rgba


class _Material:
    """The colour of a primitive's material."""

    def __init__(self, document: Document, index: int | None) -> None:
        entry = {} if index is None else document.item("materials", index)
        self._document = document
        self.extensions: dict[str, Any] = entry.get("extensions", {})
        metallic = entry.get("pbrMetallicRoughness", {})
        glossy = self.extensions.get("KHR_materials_pbrSpecularGlossiness", {})
        factor = glossy.get("diffuseFactor") if glossy else metallic.get("baseColorFactor")
        red, green, blue, alpha = (float(value) for value in factor or (1.0, 1.0, 1.0, 1.0))
        red, green, blue = (float(value) for value in encode_srgb(np.array([red, green, blue])))
        self.color = red, green, blue, min(max(alpha, 0.0), 1.0)
        self._texture = glossy.get("diffuseTexture") if glossy else metallic.get("baseColorTexture")
        self._transform: dict[str, Any] = (self._texture or {}).get("extensions", {}).get("KHR_texture_transform", {})
        channel = self._transform.get("texCoord", (self._texture or {}).get("texCoord", 0))
        self.texcoord = "" if self._texture is None else f"TEXCOORD_{channel}"
        """The attribute that holds the texture's coordinates; empty without a texture."""
        self.alpha_cutoff = self._cutoff(entry)

    def _cutoff(self, entry: dict[str, Any]) -> float | None:
        mode = entry.get("alphaMode", "OPAQUE")
        if mode == "MASK":
            return min(max(float(entry.get("alphaCutoff", 0.5)), 0.0), 1.0)
        if mode == "BLEND":
            self._document.resolver.add_note(
                f"see-through materials are drawn solid where alpha is {_BLEND_CUTOFF} or more, and not at all below"
            )
            return _BLEND_CUTOFF
        return None

    def texture(self, arrays: dict[str, NDArray[Any]]) -> tuple[Texture | None, NDArray[np.float64] | None]:
        """The base colour's texture, and its coordinates `(n, 2)` with the origin at the lower left."""
        if self.texcoord not in arrays:
            if self._texture is not None:
                self._document.resolver.add_note("a texture without texture coordinates is left out")
            return None, None
        uv = normalise(arrays[self.texcoord]).astype(np.float64).reshape(-1, 2)
        uv = _transform_uv(uv, self._transform)
        return self._read(), np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)

    def _read(self) -> Texture | None:
        document = self._document
        entry = document.item("textures", self._texture["index"])
        if "source" not in entry:
            document.resolver.add_note("a texture that is neither PNG nor JPEG is left out; export it as one of them")
            return None
        sampler = document.item("samplers", entry["sampler"]) if "sampler" in entry else {}
        image = document.item("images", entry["source"])
        uri = image.get("uri", "")
        embedded = "bufferView" in image or uri.startswith("data:")
        return document.resolver.decode_texture(
            lambda: document.image(image),
            key=f"buffer view {image['bufferView']}" if "bufferView" in image else uri,
            name=f"image {entry['source']}" if embedded else uri,
            opaque=self.alpha_cutoff is None,
            wrap_u=_WRAPS.get(sampler.get("wrapS", 10497), "repeat"),
            wrap_v=_WRAPS.get(sampler.get("wrapT", 10497), "repeat"),
        )


def _transform_uv(uv: NDArray[np.float64], transform: dict[str, Any]) -> NDArray[np.float64]:
    """KHR_texture_transform on glTF's own coordinates (origin at the upper left): offset + rotation x scale x uv."""
    scaled = uv * np.array(transform.get("scale", (1, 1)), np.float64)
    angle = float(transform.get("rotation", 0.0))
    # Counter-clockwise where v goes down, as sample models and viewers have it; the extension's GLSL is clockwise
    # (KhronosGroup/glTF issue 1563).
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned: NDArray[np.float64] = scaled @ rotation.T + np.array(transform.get("offset", (0, 0)), np.float64)
    return turned


def _note_unsupported(document: Document, node: dict[str, Any], mesh: dict[str, Any]) -> None:
    """Adds notes of what is not drawn. `mesh` is empty where another node has it already."""
    if "skin" in node:
        document.resolver.add_note("a skinned mesh is drawn as it was modelled, without its skeleton")
    if any(node.get("weights", [])) or any(mesh.get("weights", [])):
        document.resolver.add_note("morph targets are left at zero")
