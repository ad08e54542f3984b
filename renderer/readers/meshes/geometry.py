"""Conversions that mesh formats share: polygons to triangles, text to numbers, integers to fractions, placement."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.surface import Surface

MAX_NODES = 20_000
"""Most nodes in the scene of a mesh file, each counted as often as it is instanced."""


def numbers(tokens: Iterable[bytes]) -> NDArray[np.float64]:
    """The numbers that `tokens` spell, `(n,)`; `ValueError` where one is none.

    One by one: an array of bytes would make every cell as wide as the longest token.
    """
    return np.fromiter(map(float, tokens), np.float64)


def fans(lengths: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles `(m, 3)`, each polygon a fan about its first corner, and the polygon `(m,)` that each comes from.

    `lengths` `(n,)`: how many corners each polygon has. A triangle's corners are places in the list of all corners of
    all polygons, one polygon after the other. Polygons of fewer than three corners have no triangle.
    """
    counts = np.maximum(lengths - 2, 0)
    source = np.repeat(np.arange(len(lengths)), counts)
    first = (np.cumsum(lengths) - lengths)[source]
    step = np.arange(len(source)) - (np.cumsum(counts) - counts)[source]
    return np.stack([first, first + step + 1, first + step + 2], axis=1), source


def normalised(values: NDArray[Any]) -> NDArray[Any]:
    """Integers that stand for [0, 1], or for [-1, 1] where they are signed, as float32; floats as they are.

    As in glTF 2.0, section 3.6.2.2: over the most that the type holds, and never below -1.
    """
    if values.dtype.kind == "f":
        return values
    scaled: NDArray[Any] = np.maximum(values.astype(np.float32) / np.iinfo(values.dtype).max, np.float32(-1.0))
    return scaled


def place_surface(surface: Surface, matrix: NDArray[np.float64]) -> Surface:
    """The surface in world coordinates. Normals go through the inverse transpose, taken from cofactors: a flattened
    axis has no inverse.
    """
    linear = matrix[:3, :3]
    cofactors = np.stack(
        [np.cross(linear[1], linear[2]), np.cross(linear[2], linear[0]), np.cross(linear[0], linear[1])]
    )
    mirrored = float(np.linalg.det(linear)) < 0
    normals = surface.normals
    return replace(
        surface,
        vertices=surface.vertices @ linear.T + matrix[:3, 3],
        # Winding and cofactors both turn with a mirror: what is outside stays outside.
        faces=surface.faces[:, ::-1] if mirrored else surface.faces,
        normals=None if normals is None else (normals @ cofactors.T) * (-1.0 if mirrored else 1.0),
    )
