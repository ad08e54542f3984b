"""Places surfaces in a scene, once or many times.

embreex gives no access to Embree's instances, so rays too are cast at copies in memory.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.surface import Surface

MAX_COPIED = 3
"""Most triangles in all copies of surfaces, for each triangle that a mesh may have without copies."""
_VERTICES_PER_BATCH = 1 << 20
_FLAT = 1e-12  # share of the largest extent below which the second largest is a rounding error


def place_surface(surface: Surface, matrices: NDArray[np.float64]) -> Surface:
    """Returns one surface with a copy for each of the matrices `(k, 4, 4)`. Normals are transformed by a matrix's
    cofactors, because a matrix that flattens an axis has no inverse.
    """
    copies, linear = len(matrices), matrices[:, :3, :3]
    mirrored = np.linalg.det(linear) < 0  # (k,)
    vertices = surface.vertices @ linear.swapaxes(1, 2) + matrices[:, None, :3, 3]  # (k, n, 3)
    # A mirror reverses both winding and cofactors: the outside remains the outside.
    faces = np.where(mirrored[:, None, None], surface.faces[:, ::-1], surface.faces)  # (k, m, 3)
    faces = faces + (np.arange(copies) * len(surface.vertices))[:, None, None]
    normals = None
    if surface.normals is not None:
        cofactors = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]])  # (k, 3, 3)
        cofactors[mirrored] *= -1
        normals = (surface.normals @ cofactors.swapaxes(1, 2)).reshape(-1, 3)
    return replace(
        surface,
        vertices=vertices.reshape(-1, 3),
        faces=faces.reshape(-1, 3),
        normals=normals,
        colors=None if surface.colors is None else np.tile(surface.colors, (copies, 1)),
        uv=None if surface.uv is None else np.tile(surface.uv, (copies, 1)),
        copies=None,
    )


def place_copies(surface: Surface) -> Iterator[Surface]:
    """Yields the surface at each of its `copies` that has an area, in batches that bound the memory."""
    if surface.copies is None:
        yield surface
        return
    extents = np.linalg.svd(surface.copies[:, :3, :3], compute_uv=False)  # (k, 3), falling
    kept = surface.copies[extents[:, 1] > _FLAT * extents[:, 0]]
    step = max(1, _VERTICES_PER_BATCH // max(1, len(surface.vertices)))
    for start in range(0, len(kept), step):
        yield place_surface(surface, kept[start : start + step])
