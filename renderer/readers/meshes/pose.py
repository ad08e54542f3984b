"""The time at which an animated mesh is read, and the camera that it is seen from."""

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
"""The number of rays along each side of a camera's picture that measure its distances."""
_LEAST_DISTANCE = 1e-6  # of content from the camera, as a fraction of the scene's longest side


@dataclass(frozen=True)
class MeshPose:
    """The time, camera and animation that are selected from a mesh file."""

    time: float | None = None
    """Seconds from the start of the animations; None for the stored pose, without animations."""
    camera: str | None = None
    """Name or number, from 0, of the camera whose axes become those of the lens array; None for the file's own axes.

    Content behind the camera is left out, and the camera's picture is framed.
    """
    animation: str | None = None
    """Name or number, from 0, of the animation; None for the first one together with those that move other nodes."""


AS_STORED = MeshPose()
"""The pose without animations, along the file's own axes."""


@dataclass(frozen=True)
class Lens:
    """The picture of a camera at the origin that looks along -z. At the distance d along -z it shows everything within
    `base + slope * d` of the axis, to each side in x and y, from `near` to `far`.
    """

    base: tuple[float, float]
    slope: tuple[float, float]
    """Half extents in x and y, as above. Both x values are 0 if the file leaves the picture's width to the viewer."""
    near: float
    far: float


def see_through(scene: Scene, lens: Lens, name: str) -> Scene:
    """Adds a camera's window to a scene in the camera's coordinates. Triangles that lie wholly nearer or farther than
    the camera sees are left out, with a note. If the picture is empty, the whole scene is framed, with a note.

    Raises `NothingVisible` if all of the scene lies nearer or farther.
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
        notes += (f"{left_out:,} triangles lie behind the camera or outside its range, and are left out",)
    selected = replace(scene, parts=tuple(parts), notes=notes)
    depths = _sample_depths(selected, lens)
    if not len(depths):
        return replace(selected, notes=(*notes, "the camera's picture is empty: everything in front of it is framed"))
    distance = float(np.median(depths))
    width, height = (base + slope * distance for base, slope in zip(lens.base, lens.slope, strict=True))
    window = Window(float(depths.min()), distance, float(depths.max()), height, width or None)
    return replace(selected, window=window)


def _sample_depths(scene: Scene, lens: Lens) -> NDArray[np.float64]:
    """Measures the distances `(k,)` along -z of what the camera sees, with a grid of rays."""
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
