"""Cameras of a glTF file (glTF 2.0, section 3.10)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.names import find_numbered
from ciir.renderer.shading import normalize

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document


def find_view_matrix(
    document: Document, nodes: Iterable[tuple[int, dict[str, Any], NDArray[np.float64]]], camera: str
) -> NDArray[np.float64]:
    """The 4x4 matrix from the scene to the camera's coordinates: the camera at the origin, x to its right, y up.

    The lens array then looks the camera's way, and `pose.select_before` takes what does not lie behind the camera.

    `camera`: a number, counted from 0 in the order of the scene's `nodes`, or the name of a camera or of its node.
    Raises `InvalidOption` where there is no such camera.
    """
    found: list[tuple[tuple[str, str], NDArray[np.float64]]] = []
    for _, node, matrix in nodes:
        if "camera" in node:
            entry = document.item("cameras", node["camera"])
            found.append(((str(node.get("name", "")), str(entry.get("name", ""))), matrix))
    number = find_numbered("camera", camera, [titles for titles, _ in found], document.name)
    matrix = found[number][1]
    backward = normalize(matrix[:3, 2])
    up = normalize(matrix[:3, 1] - backward * (matrix[:3, 1] @ backward))
    view = np.eye(4)
    view[:3, :3] = np.cross(up, backward), up, backward  # no scale: a camera has none
    view[:3, 3] = -view[:3, :3] @ matrix[:3, 3]
    if not np.isfinite(view).all() or abs(float(np.linalg.det(view)) - 1) > 1e-6:  # a zero axis has no direction
        raise Unreadable(f"{document.name}: camera {number} has no orientation; export it again")
    document.resolver.add_note(f"camera {number}: the lens array looks its way; its angle of view plays no part")
    return view
