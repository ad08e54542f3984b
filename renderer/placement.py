"""How an object stands in front of the lens array, and where the light comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ciir.renderer.shading import LIGHT

if TYPE_CHECKING:
    from numpy.typing import NDArray

Up = Literal["y", "z"]
Fit = Literal["views", "none"]
_UPRIGHT: dict[Up, NDArray[np.float64]] = {
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),  # its -y side, the front in CAD and Blender, faces the array
}


@dataclass(frozen=True)
class Placement:
    """How an object is oriented, framed and lit.

    Directions are the lens array's: x to the right, y up, z from the object behind the array to the viewer.
    """

    up: Up = "y"
    """The axis of the mesh that points up."""
    rotate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Yaw, pitch, roll in degrees, applied in this order, each about an axis of the array and counter-clockwise as seen
    from its positive end: yaw about y turns the front to the right, pitch about x tips the top towards the array, roll
    about z tips it to the left."""
    zoom: float = 1.0
    """Factor on the size at which every view contains the whole object."""
    place: float = -1.0
    """-1: the object is wholly behind the array; 0: its bounding box is centred on it; 1: wholly in front of it."""
    light: tuple[float, float] | None = None
    """Where the light comes from, in degrees: the azimuth from the front to the right, and the elevation; None for
    `renderer.shading.LIGHT`, upper left front."""
    fit: Fit = "views"
    """`views`: as large as fits into every view, at `place`. `none`: the mesh's coordinates are those of the lens array
    (`renderer.lens_array`), as for a captured model; `place` does nothing, and turns and zoom are about the array's
    middle."""
    depth_factor: float = 1.0
    """Factor on the object's extent along z, about the array's plane, once it is placed: below 1 it is flatter, with
    less parallax, at the same size. Its colours, into which the light is baked, stay those of the whole object."""

    def rotation(self) -> NDArray[np.float64]:
        """Returns the rotation from the mesh's own axes to those of the array, `(3, 3)`."""
        yaw, pitch, roll = (make_rotation(axis, degrees) for axis, degrees in zip((1, 0, 2), self.rotate, strict=True))
        return roll @ pitch @ yaw @ _UPRIGHT[self.up]

    def light_direction(self) -> NDArray[np.float64]:
        """Returns the unit direction towards the light, `(3,)`, in the mesh's own axes: it stays as the object
        turns.
        """
        light = LIGHT
        if self.light is not None:
            azimuth, elevation = np.radians(self.light)
            across = np.cos(elevation)
            light = np.array([np.sin(azimuth) * across, np.sin(elevation), np.cos(azimuth) * across])
        turned: NDArray[np.float64] = light @ self.rotation()
        return turned


FACTORS = 0.01, 100.0
"""The smallest and the largest zoom and depth factor."""
AS_GIVEN = Placement()
"""The object as it is in its file, behind the array."""


def make_rotation(axis: int, degrees: float) -> NDArray[np.float64]:
    """Returns the rotation about a coordinate axis, `(3, 3)`, counter-clockwise as seen from its positive end."""
    angle, matrix = np.radians(degrees), np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix
