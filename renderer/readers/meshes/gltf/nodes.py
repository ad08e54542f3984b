"""The nodes of a glTF scene and their matrices (glTF 2.0, section 3.5; EXT_mesh_gpu_instancing)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes.geometry import MAX_NODES
from ciir.renderer.readers.meshes.gltf.accessors import read_accessor
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

_UNMOVED = {"TRANSLATION": (0, 0, 0), "ROTATION": (0, 0, 0, 1), "SCALE": (1, 1, 1)}


def walk_nodes(
    document: Document, moved: Mapping[int, dict[str, Any]], root: NDArray[np.float64]
) -> Iterator[tuple[int, dict[str, Any], NDArray[np.float64]]]:
    """Yields the index of each node of the scene, the node, and its matrix to the coordinates of `root`; parents first.

    `moved` holds properties that replace those of nodes, as `animations.sample_nodes` finds them.
    """
    scenes = document.json.get("scenes")
    if scenes:
        number = document.json.get("scene", 0)
        scene = document.item("scenes", number)
        roots = scene.get("nodes", [])
        if len(scenes) > 1:
            titled = clean_text(str(scene.get("name", number)))[:40]
            document.resolver.add_note(f"of {len(scenes)} scenes only the file's default, {titled}, is drawn")
    else:
        nodes = document.json.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in children]
    waiting = [(index, root, True) for index in reversed(roots)]
    seen: set[int] = set()
    while waiting:
        index, parent, is_shown = waiting.pop()
        node = document.item("nodes", index)
        if index in seen:
            raise Unreadable(f"{document.name}: node {index} has two parents or is its own ancestor; export it again")
        seen.add(index)
        if len(seen) > MAX_NODES:
            raise TooLarge(f"{document.name}: over {MAX_NODES:,} nodes, which is the limit; join them")
        node = node | moved.get(index, {})
        matrix = parent @ local_matrix(node)
        is_shown &= node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible") is not False
        if not is_shown:  # it may still be a joint or a camera
            node.pop("mesh", None)
        yield index, node, matrix
        waiting += [(child, matrix, is_shown) for child in reversed(node.get("children", []))]


def local_matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """Returns a node's own 4x4 matrix: from the file (column-major), or translation x rotation x scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    parts = [np.array([node.get(name.lower(), unmoved)], np.float64) for name, unmoved in _UNMOVED.items()]
    matrix: NDArray[np.float64] = compose_matrices(*parts)[0]
    return matrix


def compose_matrices(
    translations: NDArray[np.float64], rotations: NDArray[np.float64], scales: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Composes matrices `(k, 4, 4)` from translations `(k, 3)`, quaternions `(k, 4)` of any length, scales `(k, 3)`."""
    x, y, z, w = rotations.T
    length = np.square(rotations).sum(axis=1)
    s = np.divide(2.0, length, out=np.zeros_like(length), where=length > 0)
    matrices = np.zeros((len(rotations), 4, 4))
    matrices[:, :3, :3] = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    matrices[:, :3, :3] *= scales[:, None]
    matrices[:, :3, 3] = translations
    matrices[:, 3, 3] = 1
    return matrices


def place_instances(
    document: Document, node: dict[str, Any], matrix: NDArray[np.float64], most: int
) -> NDArray[np.float64]:
    """Returns matrices `(k, 4, 4)`: the node's matrix, or one for each instance of EXT_mesh_gpu_instancing.

    Raises `TooLarge` for more than `most` before they are read, and `Unreadable` if their attributes differ in length.
    """
    if "EXT_mesh_gpu_instancing" not in node.get("extensions", {}):
        return matrix[None]
    attributes = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    given = [name for name in _UNMOVED if name in attributes]
    counts = {int(document.item("accessors", attributes[name])["count"]) for name in given}
    if len(counts) != 1:
        raise Unreadable(f"{document.name}: attributes of instances differ in length; export it again")
    (count,) = counts
    if count > most:
        raise TooLarge(f"{document.name}: a node with {count:,} instances; at most {most:,} are read; join them")
    parts = [
        read_accessor(document, attributes[name]).astype(np.float64)
        if name in given
        else np.tile(np.array(unmoved, np.float64), (count, 1))
        for name, unmoved in _UNMOVED.items()
    ]
    placed: NDArray[np.float64] = matrix @ compose_matrices(*parts)
    return placed
