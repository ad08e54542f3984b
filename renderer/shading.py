"""The light, fixed in the world and baked into vertex colours, and the normals that it needs.

Colours are display-referred and multiply: the sRGB curve is close to a power law, so products of encoded values
equal encoded products of linear values, except for the curve's linear toe.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

LIGHT = np.array([-0.4, 0.6, 0.7]) / np.sqrt(0.4**2 + 0.6**2 + 0.7**2)
"""Unit direction towards the light in the world: upper left front."""
AMBIENT, DIFFUSE = 0.6, 0.4
CREASE = 40.0
"""A face at a larger angle, in degrees, to the smooth normal at its corner keeps its own normal there."""
FLAT = 0.1
"""The crease with which every face keeps its own normal, except for rounding."""


def encode_srgb(linear: NDArray[np.floating]) -> NDArray[np.float32]:
    """Converts linear values to display-referred sRGB (IEC 61966-2-1), both in [0, 1], any shape; clips to [0, 1]."""
    x = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def decode_srgb(encoded: NDArray[np.floating]) -> NDArray[np.float32]:
    """Converts display-referred values in [0, 1] to linear ones, any shape: the inverse of `encode_srgb`."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


def shade(normals: NDArray[np.floating], light: NDArray[np.float64] = LIGHT) -> NDArray[np.float32]:
    """Returns the light on unit normals `(n, 3)`: `0.6 + 0.4 (n . light)` in [0, 1], `(n,)`.

    The ambient share comes from all directions equally. `light`: the unit direction towards the light, `(3,)`.
    """
    shaded: NDArray[np.float32] = np.clip(AMBIENT + DIFFUSE * (normals @ light), 0.0, 1.0).astype(np.float32)
    return shaded


def normalize(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Returns vectors `(..., 3)` scaled to length 1; a zero vector stays zero."""
    vectors = np.asarray(vectors, np.float64)
    length = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
    directions: NDArray[np.float64] = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    return directions


def number_positions(vertices: NDArray[np.float64]) -> tuple[NDArray[np.intp], int]:
    """Numbers the distinct positions of vertices `(n, 3)`: each vertex's number `(n,)` and how many there are."""
    bits = np.ascontiguousarray(vertices + 0.0).view(np.uint64)  # + 0.0 makes -0.0 equal to 0.0
    key = np.zeros(len(vertices), np.uint64)
    for axis in range(3):
        key = (key ^ bits[:, axis]) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    _, first, place = np.unique(key, return_index=True, return_inverse=True)
    if not np.array_equal(vertices[first[place]], vertices):  # two positions with the same hash
        _, place = np.unique(vertices, axis=0, return_inverse=True)
        return place, int(place.max()) + 1
    return place, len(first)


def compute_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.integer], crease: float = CREASE
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Computes smooth normals, with creases, for a mesh that has none.

    A corner takes the angle-weighted mean of the normals of all faces at its position (Thuermer and Wuethrich 1998). If
    its own face's normal is more than `crease` degrees from that, it takes the face's, and the vertex is split.

    Returns `(source, faces, normals)`: the old vertex of each new one, `(k,)`; faces `(m, 3)` on the new vertices; and
    unit normals `(k, 3)`. The first n of the k new vertices are the old ones. No face may have zero area.
    """
    corners = vertices[faces]  # (m, 3 corners, 3)
    edges = normalize(np.roll(corners, -1, axis=1) - corners)  # corner i -> corner i + 1
    face_normals = normalize(np.cross(edges[:, 0], edges[:, 1]))  # (m, 3)
    cosines = -np.einsum("mci,mci->mc", edges, np.roll(edges, 1, axis=1))
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))

    place, places = number_positions(vertices)
    corner_place = place[faces]  # (m, 3)
    weighted = angles[:, :, None] * face_normals[:, None, :]
    total = [np.bincount(corner_place.ravel(), weighted[:, :, axis].ravel(), places) for axis in range(3)]
    smooth = normalize(np.stack(total, axis=1))  # (places, 3)

    agreement = np.einsum("mci,mi->mc", smooth[corner_place], face_normals)
    own = np.flatnonzero((agreement < np.cos(np.radians(crease))).ravel())
    split = faces.astype(np.int64).ravel()
    source = np.concatenate([np.arange(len(vertices)), split[own]])
    split[own] = len(vertices) + np.arange(len(own))
    return source, split.reshape(-1, 3), np.concatenate([smooth[place], face_normals[own // 3]])
