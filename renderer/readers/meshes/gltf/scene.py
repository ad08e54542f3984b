"""Reads a glTF file's scene as surfaces (Khronos glTF 2.0)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ciir.errors import TooLarge
from ciir.renderer.readers.meshes.geometry import place_surfaces
from ciir.renderer.readers.meshes.gltf.document import parse
from ciir.renderer.readers.meshes.gltf.nodes import walk_nodes
from ciir.renderer.readers.meshes.gltf.primitives import read_primitive

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.gltf.document import Document
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.surface import Surface

MAX_PRIMITIVES = 200_000
"""Most primitives in all nodes together: many nodes can share one mesh of many primitives."""


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """All triangles of a `.glb` or `.gltf` file's scene in its world coordinates, material by material.

    Raises what `document.parse` does; `Unreadable` for references to nothing; `TooLarge` over `limits`, `MAX_NODES` or
    `MAX_PRIMITIVES`; an error of Python's where the JSON does not have the shape of glTF.
    """
    document = parse(data, name=name, resolver=resolver, max_triangles=limits.triangles)
    return place_surfaces(find_surfaces(document), name=name, max_triangles=limits.triangles, max_parts=MAX_PRIMITIVES)


def find_surfaces(document: Document) -> Iterator[tuple[Surface, NDArray[np.float64]]]:
    """The surfaces of the document's scene, each with its world matrix; raises as `read` does."""
    primitives: dict[tuple[int, int], Surface | None] = {}
    seen: set[int] = set()
    placed = 0
    for node, matrix in walk_nodes(document):
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
                primitives[key] = read_primitive(document, primitive)
            surface = primitives[key]
            if surface is not None:
                yield surface, matrix


def _note_unsupported(document: Document, node: dict[str, Any], mesh: dict[str, Any]) -> None:
    """Adds notes of what is not drawn. `mesh` is empty where another node has it already."""
    if "skin" in node:
        document.resolver.add_note("a skinned mesh is drawn as it was modelled, without its skeleton")
    if any(node.get("weights", [])) or any(mesh.get("weights", [])):
        document.resolver.add_note("morph targets are left at zero")
