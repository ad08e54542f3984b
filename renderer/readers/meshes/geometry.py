"""Conversions that several mesh formats use: text to numbers, colours, placement."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge
from ciir.renderer.copies import place_surface
from ciir.renderer.surface import check_size

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.surface import Surface

BRIGHTEST = 2.0
"""The largest colour if 1 is white: scanners overshoot 1, and 8-bit levels go far beyond."""
MAX_NODES = 20_000
"""The most nodes in the scene of a mesh file. A node counts once for each of its instances."""
UPRIGHT = {
    "X_UP": np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    "Z_UP": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
}
"""Matrices that turn a scene to y up. The keys are COLLADA's names for the axis that points up in the file."""


def parse_numbers(tokens: Iterable[bytes]) -> NDArray[np.float64]:
    """Parses numbers `(n,)` one by one: in an array of bytes every cell would be as wide as the longest token.

    Raises `ValueError` if a token is not a number.
    """
    return np.fromiter(map(float, tokens), np.float64)


def normalise(values: NDArray[Any]) -> NDArray[Any]:
    """Scales integers to [0, 1], signed ones to [-1, 1], as float32 (glTF 2.0, section 3.6.2.2). Keeps floats."""
    if values.dtype.kind == "f":
        return values
    scaled: NDArray[Any] = np.maximum(values.astype(np.float32) / np.iinfo(values.dtype).max, np.float32(-1.0))
    return scaled


def scale_levels(colors: NDArray[Any], resolver: Resolver) -> NDArray[Any]:
    """Returns colours in which 1 is white. If one is over `BRIGHTEST`, they are taken as levels from 0 to 255, with a
    note.
    """
    if not (colors > BRIGHTEST).any():
        return colors
    resolver.add_note("vertex colours above 1 are taken as levels from 0 to 255")
    scaled: NDArray[Any] = colors / colors.dtype.type(255)
    return scaled


def add_alpha(colors: NDArray[Any]) -> NDArray[np.float32]:
    """Returns colours `(n, 3)` as opaque RGBA `(n, 4)`."""
    rgba = np.ones((len(colors), 4), np.float32)
    rgba[:, :3] = colors
    return rgba


def place_surfaces(
    placed: Iterable[tuple[Surface | None, NDArray[np.float64]]], *, name: str, max_triangles: int, max_parts: int
) -> list[Surface]:
    """Places each surface by its matrices, `(4, 4)` or `(k, 4, 4)`. A surface that occurs several times is returned
    once with the matrices of its copies, which are made later.

    None stands for a part that has no surface. Raises `TooLarge` if the surfaces without their copies have more than
    `max_triangles` triangles, or if there are more than `max_parts` parts, including copies and empty parts.
    """
    groups: dict[int, tuple[Surface, list[NDArray[np.float64]]]] = {}
    triangles = vertices = parts = 0
    for surface, matrix in placed:
        parts += len(matrix) if matrix.ndim == 3 else 1
        if parts > max_parts:
            raise TooLarge(f"{name}: over {max_parts:,} parts in all instances, which is the limit; join them")
        if surface is None:
            continue
        if id(surface) not in groups:
            triangles += len(surface.faces)
            vertices += len(surface.vertices)
            check_size(name, triangles, vertices, max_triangles)
        groups.setdefault(id(surface), (surface, []))[1].append(matrix.reshape(-1, 4, 4))
    return [_place(surface, np.concatenate(matrices)) for surface, matrices in groups.values()]


def _place(surface: Surface, matrices: NDArray[np.float64]) -> Surface:
    return place_surface(surface, matrices) if len(matrices) == 1 else replace(surface, copies=matrices)


def split_corners(surface: Surface) -> Surface:
    """Returns the surface with three vertices of its own for each triangle."""
    index = surface.faces.ravel()
    if len(index) and not 0 <= index.min() <= index.max() < len(surface.vertices):
        raise IndexError("a face names a vertex that is not there")
    return replace(
        surface,
        vertices=surface.vertices[index],
        faces=np.arange(len(index)).reshape(-1, 3),
        normals=None if surface.normals is None else surface.normals[index],
    )
