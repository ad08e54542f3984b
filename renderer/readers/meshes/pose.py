"""The moment at which a mesh is read, and the camera that it is seen from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import NothingVisible
from ciir.renderer.scene import Window

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.scene import Scene

_RAYS = 64
"""Rays along each side of a camera's picture that measure its distances."""
_LEAST_DISTANCE = 1e-6  # of a subject, times the scene's longest side


@dataclass(frozen=True)
class MeshPose:
    """What of a file that holds animations or cameras is shown."""

    time: float | None = None
    """Seconds from the start of its animations; None for the pose that is stored without them."""
    camera: str | None = None
    """Name or number, from 0, of the camera whose axes become those of the lens array; None for the file's own.

    What lies behind the camera is left out, and its picture is framed.
    """
    animation: str | None = None
    """Name or number, from 0, of the animation; None for the first, with those that move other nodes."""


AS_STORED = MeshPose()
"""Without animations, along the file's own axes."""


@dataclass(frozen=True)
class Lens:
    """What a camera at the origin, looking along -z, has in its picture: at the distance d along -z all within
    `base + slope * d` of its axis, to each side in x and y, from `near` to `far`.
    """

    base: tuple[float, float]
    slope: tuple[float, float]
    """Both 0 in x where the picture's width is left to who shows it."""
    near: float
    far: float


def see_through(scene: Scene, lens: Lens, name: str) -> Scene:
    """A scene in a camera's coordinates with its window, without the triangles that lie wholly nearer or farther than
    the camera sees, with a note. Where its picture shows nothing all of the scene is framed, with a note.

    Raises `NothingVisible` where all of it lies nearer or farther.
    """
    parts, left_out = [], 0
    for part in scene.parts:
        z = part.vertices[:, 2][part.faces]  # (m, 3)
        is_seen = (z.min(axis=1) < -max(lens.near, 0.0)) & (z.max(axis=1) > -lens.far)
        left_out += int((~is_seen).sum())
        if is_seen.any():
            parts.append(part if is_seen.all() else replace(part, faces=part.faces[is_seen]))
    if not parts:
        raise NothingVisible(f"{name}: all of it lies behind the camera; give another camera, or leave it out")
    notes = scene.notes
    if left_out:
        notes += (f"{left_out:,} triangles lie behind the camera or out of its range, and are left out",)
    selected = replace(scene, parts=tuple(parts), notes=notes)
    depths = _sample_depths(selected, lens)
    if not len(depths):
        return replace(
            selected, notes=(*notes, "the camera's picture shows nothing: all that lies before it is framed")
        )
    distance = float(np.median(depths))
    width, height = (base + slope * distance for base, slope in zip(lens.base, lens.slope, strict=True))
    window = Window(float(depths.min()), distance, float(depths.max()), height, width or None)
    return replace(selected, window=window)


def _sample_depths(scene: Scene, lens: Lens) -> NDArray[np.float64]:
    """The distances along -z of what the camera sees, `(k,)`, by a grid of rays."""
    from ciir.renderer.backends.embree import PreparedScene

    places = (np.arange(_RAYS) + 0.5) / _RAYS * 2 - 1
    across, down = (places.ravel() for places in np.meshgrid(places, places))
    far = np.ones(len(across))
    (base_x, base_y), (slope_x, slope_y) = lens.base, lens.slope
    base_x, slope_x = (base_x, slope_x) if base_x + slope_x else (base_y, slope_y)
    directions = np.stack([slope_x * across, slope_y * down, -far], axis=1)
    origins = np.stack([base_x * across, base_y * down, 0 * far], axis=1) + max(lens.near, 0.0) * directions
    _, depths = PreparedScene(scene, whole_lines=False).cast(origins, directions)
    depths = depths + max(lens.near, 0.0)
    low, high = scene.bounds()
    least = _LEAST_DISTANCE * float((high - low).max())
    return depths[np.isfinite(depths) & (depths > least) & (depths <= lens.far)]
