"""The moment at which a mesh is read, and the camera that it is seen from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeshPose:
    """What of a file that holds animations or cameras is shown."""

    time: float | None = None
    """Seconds from the start of its animations; None for the pose that is stored without them."""
    camera: str | None = None
    """Name or number, from 0, of the camera whose axes become those of the lens array; None for the file's own."""


AS_STORED = MeshPose()
"""Without animations, along the file's own axes."""
