"""The moment at which a mesh is read, and the camera that it is seen from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ciir.errors import InvalidGeometry

if TYPE_CHECKING:
    from ciir.renderer.scene import Scene


@dataclass(frozen=True)
class MeshPose:
    """What of a file that holds animations or cameras is shown."""

    time: float | None = None
    """Seconds from the start of its animations; None for the pose that is stored without them."""
    camera: str | None = None
    """Name or number, from 0, of the camera whose axes become those of the lens array; None for the file's own.

    What lies behind the camera is left out. All that lies before it is framed as a mesh is without a camera: a lens
    array sees along parallel rays, so that the camera's angle of view plays no part.
    """
    animation: str | None = None
    """Name or number, from 0, of the animation; None for the first, with those that move other nodes."""


AS_STORED = MeshPose()
"""Without animations, along the file's own axes."""


def select_before(scene: Scene, name: str) -> Scene:
    """A scene in a camera's coordinates without the triangles that lie wholly behind it (z >= 0), with a note.

    Raises `InvalidGeometry` where all do.
    """
    parts, left_out = [], 0
    for part in scene.parts:
        is_before = (part.vertices[:, 2] < 0)[part.faces].any(axis=1)
        left_out += int((~is_before).sum())
        if is_before.any():
            parts.append(part if is_before.all() else replace(part, faces=part.faces[is_before]))
    if not parts:
        raise InvalidGeometry(f"{name}: all of it lies behind the camera; give another camera, or leave it out")
    if not left_out:
        return scene
    note = f"{left_out:,} triangles lie behind the camera and are left out"
    return replace(scene, parts=tuple(parts), notes=(*scene.notes, note))
