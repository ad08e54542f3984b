"""Finds the cameras of a glTF file (glTF 2.0, section 3.10)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.pose import Lens
from ciir.renderer.readers.names import find_numbered
from ciir.renderer.shading import normalize
from ciir.renderer.surface import MAX_COORDINATE

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

_LEAST = 1e-6
"""The smallest half extent of a camera's picture: its own if it is orthographic, else that at distance 1."""


def find_camera(
    document: Document, nodes: Iterable[tuple[int, dict[str, Any], NDArray[np.float64]]], camera: str
) -> tuple[NDArray[np.float64], Lens]:
    """Finds a camera. Returns the 4x4 matrix from the scene to its coordinates, with the camera at the origin, x to its
    right and y up; and its lens.

    `camera` is a number, counted from 0 in the order of the scene's `nodes`, or the name of a camera or of its node.
    Raises `InvalidOption` if there is no such camera.
    """
    found: list[tuple[tuple[str, str], NDArray[np.float64], dict[str, Any]]] = []
    for _, node, matrix in nodes:
        if "camera" in node:
            entry = document.item("cameras", node["camera"])
            found.append(((str(node.get("name", "")), str(entry.get("name", ""))), matrix, entry))
    number = find_numbered("camera", camera, [titles for titles, *_ in found], document.name)
    _, matrix, entry = found[number]
    backward = normalize(matrix[:3, 2])
    up = normalize(matrix[:3, 1] - backward * (matrix[:3, 1] @ backward))
    view = np.eye(4)
    view[:3, :3] = np.cross(up, backward), up, backward  # without scale, as a camera has none
    view[:3, 3] = -view[:3, :3] @ matrix[:3, 3]
    if not np.isfinite(view).all() or abs(float(np.linalg.det(view)) - 1) > 1e-6:  # a zero axis has no direction
        raise Unreadable(f"{document.name}: camera {number} has no orientation; export it again")
    lens = _read_lens(entry)
    extents = lens.base[1] + lens.slope[1], lens.base[0] + lens.slope[0]
    if not (_LEAST <= extents[0] <= MAX_COORDINATE and (extents[1] == 0 or _LEAST <= extents[1] <= MAX_COORDINATE)):
        raise Unreadable(f"{document.name}: camera {number} has no field of view; export it again")
    note = f"camera {number}: its picture fits into the centre view"
    if lens.slope[1] > 0:  # the rays of an orthographic camera are parallel, as in views
        note += (
            " at the subject's distance; nearer or farther content has a different size than in the camera's picture, "
            "as views have a different perspective or none"
        )
    document.resolver.add_note(note)
    return view, lens


def _read_lens(entry: dict[str, Any]) -> Lens:
    """Reads the lens of a perspective or orthographic camera (sections 3.10.3.2 and 3.10.3.3)."""
    if entry["type"] == "orthographic":
        values = entry["orthographic"]
        base = abs(float(values["xmag"])), abs(float(values["ymag"]))
        return Lens(base, (0.0, 0.0), float(values["znear"]), float(values["zfar"]))
    values = entry["perspective"]
    field = float(values["yfov"])
    slope = float(np.tan(field / 2)) if field < np.pi else 0.0
    aspect = float(values.get("aspectRatio", 0.0))
    return Lens((0.0, 0.0), (aspect * slope, slope), float(values["znear"]), float(values.get("zfar", np.inf)))
