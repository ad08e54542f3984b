"""Finds triangles at the same place that face opposite ways, as older files make two-sided surfaces without glTF's
`doubleSided`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.shading import number_positions

if TYPE_CHECKING:
    from numpy.typing import NDArray


def find_reverses(
    vertices: NDArray[np.float64], faces: NDArray[np.int32]
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Numbers the positions of vertices `(n, 3)`, `(n,)`, and finds for each of the `faces` `(m, 3)` one that has its
    corners at the same positions in reverse order, `(m,)`, or -1 if there is none.
    """
    place, _ = number_positions(vertices)
    corners = place[faces]
    order = np.argsort(corners, axis=1)
    is_even = np.isin(order @ [9, 3, 1], (5, 15, 19))  # 012, 120 and 201: the corners' order as it is
    ascending = np.take_along_axis(corners, order, axis=1)
    sorting = np.lexsort(ascending.T)
    following = ascending[sorting]
    first, second = sorting[:-1], sorting[1:]
    pairs = (following[1:] == following[:-1]).all(axis=1) & (is_even[second] != is_even[first])
    reverse = np.full(len(faces), -1, np.int32)
    reverse[first[pairs]], reverse[second[pairs]] = second[pairs], first[pairs]
    return place, reverse
