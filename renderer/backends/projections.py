"""Projection matrices, from camera coordinates (the array's, or one lens's) to OpenGL's clip coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.views import View


def make_oblique_matrix(array: LensArray, view: View, near: float, far: float) -> NDArray[np.float64]:
    """Returns the 4x4 projection of view (v, u): its rays are parallel, so points are sheared along them onto the
    array.

    A point (px, py, pz) appears where the ray through it along (tx, ty, -1) leaves the plane z = 0: at
    `X = px + tx * pz`, `Y = py + ty * pz`. Clip x is X over half the array's width. Clip z is linear in the depth: -1
    at `near`, 1 at `far`.
    """
    tx, ty = array.tangent_x()[view[1]], array.tangent_y()[view[0]]
    half_width, half_height = array.width / 2, array.height / 2
    return np.array(
        [
            [1 / half_width, 0, tx / half_width, 0],
            [0, 1 / half_height, ty / half_height, 0],
            [0, 0, -2 / (far - near), -(far + near) / (far - near)],
            [0, 0, 0, 1],
        ]
    )


def make_perspective_matrix(array: LensArray, near: float, far: float) -> NDArray[np.float64]:
    """Returns the 4x4 projection of one elemental image, for a camera at its lens.

    Clip x is tx over half the range of tangents.
    """
    half_tx, half_ty = array.pixels_u * array.delta / 2, array.pixels_v * array.delta / 2
    return np.array(
        [
            [1 / half_tx, 0, 0, 0],
            [0, 1 / half_ty, 0, 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )
