"""Cameras of a glTF file (glTF 2.0, section 3.10)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.readers.names import clean_text
from ciir.renderer.shading import normalize

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

_LISTED = 10


def find_view_matrix(
    document: Document, nodes: Iterable[tuple[int, dict[str, Any], NDArray[np.float64]]], camera: str
) -> NDArray[np.float64]:
    """The 4x4 matrix that turns the scene so that the camera's axes are those of the lens array, and adds a note.

    The array then looks the camera's way: x to its right, y up, z towards who looks. The camera's position and angle
    of view play no part: a lens array sees along parallel rays, and the whole object is framed as without a camera.

    `camera`: a number, counted from 0 in the order of the scene's `nodes`, or the name of a camera or of its node.
    Raises `InvalidOption` where there is no such camera.
    """
    found = []
    for _, node, matrix in nodes:
        if "camera" in node:
            entry = document.item("cameras", node["camera"])
            found.append(((str(node.get("name", "")), str(entry.get("name", ""))), matrix))
    if not found:
        raise InvalidOption(f"camera: {document.name} holds no camera; leave it out")
    numbers = {str(number): number for number in range(len(found))}
    named = {name: number for number, (names, _) in reversed(list(enumerate(found))) for name in names if name}
    number = numbers.get(camera, named.get(camera))
    if number is None:
        listed = ", ".join(f"{i} ({clean_text(names[0] or names[1])[:40]})" for i, (names, _) in enumerate(found))
        known = listed if len(found) <= _LISTED else f"0 to {len(found) - 1}"
        raise InvalidOption(f"camera: {clean_text(camera)[:40]!r} is none of {document.name}'s; give {known}")
    backward = normalize(found[number][1][:3, 2])
    up = normalize(found[number][1][:3, 1] - backward * (found[number][1][:3, 1] @ backward))
    view = np.eye(4)
    view[:3, :3] = np.cross(up, backward), up, backward
    if not np.isfinite(view).all() or abs(float(np.linalg.det(view)) - 1) > 1e-6:  # a zero axis has no direction
        raise Unreadable(f"{document.name}: camera {number} has no orientation; export it again")
    document.resolver.add_note(
        f"camera {number}: its orientation is taken, not its position and angle of view: the whole object is framed"
    )
    return view
