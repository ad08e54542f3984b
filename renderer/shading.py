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
CREASE = 44.0
"""Faces that meet at a larger angle, in degrees, are not smooth where they meet. It is no angle of a regular prism, at
which rounding would decide."""
FLAT = 0.1
"""The crease with which every face keeps its own normal, except for rounding."""
MAX_FACES = 256
"""Most faces at a position with a crease that are compared with one another: the time grows with their square."""
_ROUNDING = 1e-9  # share of the sum of a body's volumes without their signs: a smaller volume is a rounding error
_PAIRS = 1 << 18
"""Pairs of faces that are compared at once: larger arrays don't fit into a processor's cache."""


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


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the cross products of vectors `(n, 3)`: as `np.cross`, in less than half the time."""
    product = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return product


def number_positions(vertices: NDArray[np.float64]) -> tuple[NDArray[np.intp], int]:
    """Numbers the distinct positions of vertices `(n, 3)`: each vertex's number `(n,)` and how many there are."""
    _, first, place = np.unique(_hash_positions(vertices), return_index=True, return_inverse=True)
    if not np.array_equal(vertices[first[place]], vertices):  # two positions with the same hash
        _, place = np.unique(vertices, axis=0, return_inverse=True)
        return place, int(place.max()) + 1
    return place, len(first)


def _hash_positions(vertices: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Returns numbers `(n,)` of vertices `(n, 3)`: equal for equal positions, and hardly ever for others."""
    bits = np.ascontiguousarray(vertices + 0.0).view(np.uint64)  # + 0.0 makes -0.0 equal to 0.0
    key = np.zeros(len(vertices), np.uint64)
    for axis in range(3):
        key = _mix(key ^ bits[:, axis])
    return key


def _mix(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    numbers = numbers * np.uint64(0x9E3779B97F4A7C15)
    numbers ^= numbers >> np.uint64(29)
    return numbers


def is_solid(vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> bool:
    """Checks whether faces `(m, 3)` enclose bodies with their fronts outside, so that no back is seen.

    Each edge then occurs once in each direction. Edges are added up as random numbers, which are negative in the other
    direction, so that the sum over a closed body is 0. This sum separates bodies that follow one another in `faces`.
    Each of them must have a positive volume; others need it only together.
    """
    corners = _hash_positions(vertices).take(faces.T)  # (3, m)
    following = corners[[1, 2, 0]]
    edges = _mix(_mix(corners) + following) - _mix(_mix(following) + corners)
    sums = np.cumsum(edges.sum(axis=0))  # of all faces up to each, modulo 2^64
    if not len(sums) or sums[-1] != 0:
        return False
    a, b, c = (vertices - vertices.mean(axis=0)).take(faces.T, axis=0)  # (m, 3) each
    volumes = np.einsum("mi,mi->m", a, cross(b, c))
    starts = np.append(0, np.flatnonzero(sums == 0)[:-1] + 1)
    signed, unsigned = (np.add.reduceat(values, starts) for values in (volumes, np.abs(volumes)))
    return bool((signed > _ROUNDING * unsigned).all())


def compute_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.integer], crease: float = CREASE
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Computes smooth normals, with creases, for a mesh that has none.

    A corner takes the angle-weighted mean (Thuermer and Wuethrich 1998) of the normals of those faces at its position
    that are within `crease` degrees of its own face's normal. If that leaves out a face, the vertex is split. Where
    over `MAX_FACES` faces with a crease meet, and for `FLAT`, every corner takes its own face's normal.

    Returns `(source, faces, normals)`: the old vertex of each new one, `(k,)`; faces `(m, 3)` on the new vertices; and
    unit normals `(k, 3)`. The first n of the k new vertices are the old ones. No face may have zero area.
    """
    corners = vertices.take(faces, axis=0)  # (m, 3 corners, 3)
    edges = normalize(np.roll(corners, -1, axis=1) - corners)  # corner i -> corner i + 1
    face_normals = normalize(cross(edges[:, 0], edges[:, 1]))  # (m, 3)
    cosines = -np.einsum("mci,mci->mc", edges, np.roll(edges, 1, axis=1))
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))

    place, places = number_positions(vertices)
    corner_place = place[faces]  # (m, 3)
    weighted = [(angles * axis[:, None]).ravel() for axis in face_normals.T]
    total = [np.bincount(corner_place.ravel(), values, places) for values in weighted]
    smooth = normalize(np.stack(total, axis=1))  # (places, 3)

    agreement = np.einsum("mci,mi->mc", smooth.take(corner_place, axis=0), face_normals)
    has_crease = np.zeros(places, np.bool_)
    has_crease[corner_place[agreement < np.cos(np.radians(crease / 2))]] = True  # others are within it of one another
    own = np.flatnonzero(has_crease[corner_place].ravel())
    own_normals, like = face_normals.take(own // 3, axis=0), np.arange(len(own))
    split = faces.astype(np.int64).ravel()
    if crease > FLAT and len(own):
        own_normals, like = _average_similar(
            corner_place.ravel()[own], split[own], own_normals, angles.ravel()[own], np.cos(np.radians(crease))
        )
        is_split = like >= 0
        own, own_normals, like = own[is_split], own_normals[is_split], (np.cumsum(is_split) - 1)[like[is_split]]
    is_first = like == np.arange(len(own))
    source = np.concatenate([np.arange(len(vertices)), split[own[is_first]]])
    split[own] = len(vertices) + (np.cumsum(is_first) - 1)[like]
    return source, split.reshape(-1, 3), np.concatenate([smooth.take(place, axis=0), own_normals[is_first]])


def _average_similar(
    place: NDArray[np.intp],
    vertex: NDArray[np.int64],
    normals: NDArray[np.float64],
    weights: NDArray[np.float64],
    least: float,
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Averages the unit normals `(n, 3)` of corners with those at the same `place` `(n,)` whose cosine to them is at
    least `least`, with `weights` `(n,)`.

    Returns the means, `(n, 3)`, of length 1, and the first corner of the same `vertex` `(n,)` that has the same mean,
    `(n,)`, or -1 where the mean is over all corners at a place. At places with more than `MAX_FACES` corners, means are
    the normals themselves.
    """
    order = np.argsort(place, kind="stable")
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    means, like = normals.copy(), np.arange(len(place))
    for count in np.flatnonzero(np.bincount(counts[counts <= MAX_FACES])).tolist():  # np.unique imports np.ma
        firsts = starts[counts == count]
        for some in np.array_split(firsts, -(-len(firsts) * count**2 // _PAIRS)):
            corners = order[some + np.arange(count)[:, None]]  # (count, k)
            x, y, z = normals.take(corners.ravel(), axis=0).T.reshape(3, *corners.shape)
            similar = x[:, None] * x + y[:, None] * y + z[:, None] * z >= least  # (count, count, k)
            heavy, own = weights.take(corners), vertex.take(corners)
            sums = [np.einsum("ijk,jk->ik", similar, axis * heavy) for axis in (x, y, z)]
            means[corners] = np.stack(sums, axis=2)
            is_whole, same = similar.all(axis=1), np.ones_like(similar)
            for values in (own, is_whole, *sums):
                same &= values[:, None] == values
            first = np.take_along_axis(corners, same.argmax(axis=1), axis=0)
            like[corners] = np.where(is_whole, -1, first)
    return normalize(means), like
