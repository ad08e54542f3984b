"""Makes shapes, noise and colours for the sample scenes with numpy: the same on every machine up to rounding."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.placement import make_rotation

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ciir.renderer.surface import Surface

_LATTICE = 64  # a power of two


def make_grid_faces(rows: int, cols: int) -> NDArray[np.int64]:
    """Returns the triangles `(2*(rows-1)*(cols-1), 3)` of a grid of `rows x cols` vertices, numbered row by row.

    Seen with rows going up and columns to the right, they wind counter-clockwise.
    """
    number = np.arange(rows * cols).reshape(rows, cols)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def revolve(profile: ArrayLike, segments: int) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Revolves a profile about the y axis: vertices `(k*(segments+1), 3)`, faces and uv.

    `profile`: `(k, 2)` of radius and y; faces point outwards where y rises. u goes around from 0 to 1, v along the
    profile by its length.
    """
    points = np.asarray(profile, np.float64)
    turn = np.arange(segments + 1) % segments * (2 * np.pi / segments)  # % segments: both sides of the seam coincide
    radius, height = points[:, :1], points[:, 1:]
    vertices = np.stack(np.broadcast_arrays(radius * np.sin(turn), height, radius * np.cos(turn)), axis=-1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    u, v = np.meshgrid(np.linspace(0, 1, segments + 1), along / along[-1])
    vertices = vertices.reshape(-1, 3)
    faces = drop_slivers(vertices, make_grid_faces(len(points), segments + 1))
    return vertices, faces, np.stack([u, v], -1).reshape(-1, 2)


def drop_slivers(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns the faces without those that have two corners at the same position, as where a profile meets the axis."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    distinct = [np.abs(p - q).max(axis=1) > 1e-12 for p, q in ((a, b), (b, c), (c, a))]
    return faces[np.logical_and.reduce(distinct)]


def sample_curve(points: ArrayLike, count: int) -> NDArray[np.float64]:
    """Returns `(count, 2)` points on a Catmull-Rom curve through `points` `(k, 2)`; a doubled point is a corner."""
    p = np.asarray(points, np.float64)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    at = np.linspace(0, len(p) - 3 - 1e-9, count)
    i, t = at.astype(int), (at % 1)[:, None]
    before, start, end, after = (p[i + k] for k in range(4))
    square, cube = 2 * before - 5 * start + 4 * end - after, 3 * start - before - 3 * end + after
    points_between: NDArray[np.float64] = 0.5 * (2 * start + (end - before) * t + square * t**2 + cube * t**3)
    points_between[-1] = p[-2]  # exactly, so that what is revolved is closed
    return points_between


def make_torus(
    radius: float, thickness: float, segments: int, sides: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Makes a torus about the z axis: vertices `(n, 3)` and faces."""
    around, across = np.meshgrid(
        np.arange(segments + 1) % segments * (2 * np.pi / segments),
        np.arange(sides + 1) % sides * (2 * np.pi / sides),
        indexing="ij",
    )
    distance = radius + thickness * np.cos(across)
    vertices = np.stack(
        [distance * np.cos(around), distance * np.sin(around), -thickness * np.sin(across)], axis=-1
    ).reshape(-1, 3)
    return vertices, make_grid_faces(segments + 1, sides + 1)


def rotate_vertices(vertices: NDArray[np.float64], axis: int, degrees: float) -> NDArray[np.float64]:
    """Returns the vertices rotated about a coordinate axis, counter-clockwise as seen from its positive end."""
    return vertices @ make_rotation(axis, degrees).T


def blend(
    low: tuple[float, float, float], high: tuple[float, float, float], amount: NDArray[np.floating]
) -> NDArray[Any]:
    """Returns colours `(..., 3)` from `low` to `high` as `amount` goes from 0 to 1, clipped to them."""
    share = np.clip(amount, 0.0, 1.0)[..., None]
    colors: NDArray[Any] = np.array(low, share.dtype) + share * np.subtract(high, low, dtype=share.dtype)
    return colors


def smooth_step(edge: float, width: float, values: NDArray[np.floating]) -> NDArray[Any]:
    """Returns 0 below `edge`, 1 above it, smooth over `width`."""
    t = np.clip((values - edge) / width + 0.5, 0.0, 1.0)
    eased: NDArray[Any] = t * t * (3 - 2 * t)
    return eased


def sample_noise(
    points: NDArray[np.floating], *, frequency: float, octaves: int = 1, seed: int = 0
) -> NDArray[np.float32]:
    """Returns value noise at points `(..., 3)`, smooth, about [-1, 1]; each octave is twice as fine and half as
    strong.
    """
    total = np.zeros(points.shape[:-1], np.float32)
    weight = 0.0
    for octave in range(octaves):
        strength = 0.5**octave
        total += strength * _value_noise(points, frequency * 2**octave, seed + octave)
        weight += strength
    return total / np.float32(weight)


def _value_noise(points: NDArray[np.floating], frequency: float, seed: int) -> NDArray[np.float32]:
    lattice = _lattice(seed)
    at = np.asarray(points, np.float32) * np.float32(frequency) + np.float32(0.37)
    low = np.floor(at)
    t = at - low
    t = t * t * (3 - 2 * t)
    i = low.astype(np.int32) & _LATTICE - 1
    j = i + 1 & _LATTICE - 1
    x0, y0, z0 = i[..., 0] * _LATTICE**2, i[..., 1] * _LATTICE, i[..., 2]
    x1, y1, z1 = j[..., 0] * _LATTICE**2, j[..., 1] * _LATTICE, j[..., 2]
    tx, ty, tz = t[..., 0], t[..., 1], t[..., 2]

    def between(a: NDArray[np.float32], b: NDArray[np.float32], t: NDArray[np.float32]) -> NDArray[np.float32]:
        b -= a
        b *= t
        b += a
        return b

    def along_z(base: NDArray[np.int32]) -> NDArray[np.float32]:
        return between(lattice[base + z0], lattice[base + z1], tz)

    def along_y(base: NDArray[np.int32]) -> NDArray[np.float32]:
        return between(along_z(base + y0), along_z(base + y1), ty)

    return between(along_y(x0), along_y(x1), tx)


@cache
def _lattice(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(-1, 1, _LATTICE**3).astype(np.float32)


def to_rgba(colors: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Returns colours `(h, w, 3)` in [0, 1] as opaque 8-bit RGBA `(h, w, 4)`."""
    pixels = np.full((*colors.shape[:2], 4), 255, np.uint8)
    pixels[:, :, :3] = np.clip(np.rint(colors * 255), 0, 255)
    return pixels


def to_vertex_colors(colors: NDArray[np.floating]) -> NDArray[np.float32]:
    """Returns colours `(n, 3)` in [0, 1] as opaque RGBA `(n, 4)`."""
    return np.concatenate([np.clip(colors, 0, 1), np.ones((len(colors), 1))], axis=1).astype(np.float32)


def rotate_surfaces(surfaces: list[Surface], axis: int, degrees: float) -> list[Surface]:
    """Returns the surfaces rotated about a coordinate axis."""
    return [replace(surface, vertices=rotate_vertices(surface.vertices, axis, degrees)) for surface in surfaces]
