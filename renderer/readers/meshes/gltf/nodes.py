"""The nodes of a glTF scene and their matrices (glTF 2.0, section 3.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes.geometry import MAX_NODES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document


def walk_nodes(document: Document) -> Iterator[tuple[dict[str, Any], NDArray[np.float64]]]:
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
