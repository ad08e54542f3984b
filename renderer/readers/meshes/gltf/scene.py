"""Reads a glTF file's scene as surfaces (Khronos glTF 2.0)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge
from ciir.renderer.readers.meshes.geometry import place_surfaces
from ciir.renderer.readers.meshes.gltf.animations import sample_nodes
from ciir.renderer.readers.meshes.gltf.cameras import find_camera
from ciir.renderer.readers.meshes.gltf.document import parse
from ciir.renderer.readers.meshes.gltf.nodes import place_instances, walk_nodes
from ciir.renderer.readers.meshes.gltf.primitives import read_primitive
from ciir.renderer.readers.meshes.gltf.skins import find_joint_matrices
from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.gltf.document import Document
    from ciir.renderer.readers.meshes.pose import Lens
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.surface import Surface

MAX_PRIMITIVES = 200_000
"""The most primitives in all nodes and instances together: many nodes can share one mesh with many primitives."""


def read(
    data: bytes, *, name: str, resolver: Resolver, limits: Limits, pose: MeshPose = AS_STORED
) -> tuple[list[Surface], Lens | None]:
    """Reads all triangles of a `.glb` or `.gltf` file's scene, material by material: in world coordinates, or, if
    `pose` selects a camera, in the camera's coordinates, with its lens.

    Raises the errors of `document.parse`; `InvalidOption` for a `pose` that the file doesn't have; `Unreadable` for
    references to missing items; `TooLarge` over `limits`, `MAX_NODES` or `MAX_PRIMITIVES`; or a built-in Python error
    if the JSON doesn't have the structure of glTF.
    """
    document = parse(data, name=name, resolver=resolver, max_triangles=limits.triangles)
    moved = {} if pose.time is None else sample_nodes(document, pose.time, pose.animation)
    root, lens = np.eye(4), None
    if pose.camera is not None:
        root, lens = find_camera(document, walk_nodes(document, moved, root), pose.camera)
    surfaces = find_surfaces(document, moved, root)
    return place_surfaces(surfaces, name=name, max_triangles=limits.triangles, max_parts=MAX_PRIMITIVES), lens


def find_surfaces(
    document: Document, moved: Mapping[int, dict[str, Any]], root: NDArray[np.float64]
) -> Iterator[tuple[Surface | None, NDArray[np.float64]]]:
    """Yields the surface of each primitive and the matrices `(k, 4, 4)` of its instances. Raises as `read` does.

    `moved` and `root` are as in `nodes.walk_nodes`.
    """
    nodes = list(walk_nodes(document, moved, root))
    world = {index: matrix for index, _, matrix in nodes}
    primitives: dict[tuple[int, int | None, int | None, int], Surface | None] = {}
    weights: dict[int, list[tuple[int, float]]] = {}  # by mesh
    skins: dict[int, NDArray[np.float64] | None] = {}
    placed = 0
    for index, node, matrix in nodes:
        if "mesh" not in node:
            continue
        mesh = document.item("meshes", node["mesh"])
        matrices = place_instances(document, node, matrix, MAX_PRIMITIVES)
        skin = node.get("skin")
        if skin is not None and skin not in skins:
            skins[skin] = find_joint_matrices(document, skin, world)
        joints = None if skin is None else skins[skin]
        if joints is not None:
            matrices = np.eye(4)[None]  # only its joints place a skinned mesh
        placed += max(1, len(mesh["primitives"])) * len(matrices)
        if placed > MAX_PRIMITIVES:
            raise TooLarge(
                f"{document.name}: over {MAX_PRIMITIVES:,} primitives in its nodes, which is the limit; join them"
            )
        if node["mesh"] not in weights:
            weights[node["mesh"]] = _find_nonzero(mesh.get("weights", ()))
        own = _find_nonzero(node["weights"]) if "weights" in node else weights[node["mesh"]]
        shape = index if "weights" in node else None
        for number, primitive in enumerate(mesh["primitives"]):
            key = node["mesh"], shape, skin, number
            if key not in primitives:
                primitives[key] = read_primitive(document, primitive, own, joints)
            yield primitives[key], matrices


def _find_nonzero(weights: Any) -> list[tuple[int, float]]:
    """Returns the indices of the morph targets whose weight is not 0, and their weights."""
    return [(target, float(weight)) for target, weight in enumerate(weights) if weight]
