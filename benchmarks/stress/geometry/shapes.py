"""Scenes at the limits of float32: needles, sheets close behind one another, millions of triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.scene import Part, Scene
from ciir.renderer.scenes.modelling import make_grid_faces, sample_noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Values = NDArray[np.float64]

RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
_SQUARE = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def compute_ramp(x: Values, y: Values, side: float) -> Values:
    """Returns a colour `(..., 3)` in [0, 1] that is linear in the position: any triangulation shows it exactly."""
    return np.stack(np.broadcast_arrays(x / side + 0.5, y / side + 0.5, 0.5), axis=-1)


def add_alpha(colors: NDArray[np.floating], alpha: float = 1.0) -> NDArray[np.float32]:
    """Adds this alpha to RGB `(n, 3)`: `(n, 4)`."""
    return np.concatenate([colors, np.full((len(colors), 1), alpha)], axis=1).astype(np.float32)


def make_sheet(
    distance: float, side: float, color: Sequence[float], *, slope: float = 0.0, cutoff: float | None = None
) -> Part:
    """Makes a square of one colour that recedes by `slope` along x. With `cutoff`, its alpha is half the cutoff, so it
    is cut away.
    """
    half = side / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    vertices = np.column_stack([corners, -distance - slope * corners[:, 0]])
    return Part(
        vertices, _SQUARE, add_alpha(np.tile(color, (4, 1)), 1.0 if cutoff is None else cutoff / 2), None, None, cutoff
    )


def make_speck(distance: float, at: float) -> Part:
    """Makes a triangle out of sight, `at` units aside, so that the scene reaches to `distance`."""
    vertices = np.array([[at, at, -distance], [at + 1, at, -distance], [at, at + 1, -distance]])
    return Part(vertices, np.array([[0, 1, 2]], np.int32), add_alpha(np.ones((3, 3))))


def make_soup(count: int, *, side: float, distance: float, alpha: tuple[float, float]) -> Scene:
    """Makes large random triangles around `distance` that cross each other: see-through, with alpha in a range."""
    random = np.random.default_rng(5)
    vertices = random.uniform(-side / 2, side / 2, (3 * count, 3)) - [0.0, 0.0, distance]
    colors = np.column_stack([random.random((3 * count, 3)), random.uniform(*alpha, 3 * count)]).astype(np.float32)
    return Scene((Part(vertices, np.arange(3 * count, dtype=np.int32).reshape(-1, 3), colors, is_see_through=True),))


def make_needles(count: int, *, radius: float, distance: float) -> Scene:
    """Makes a disc of `count` triangles that meet in its middle, coloured by `compute_ramp` over its diameter."""
    turn = np.arange(count) * (2 * np.pi / count)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(count, -distance)], axis=1)
    vertices = np.concatenate([[[0.0, 0.0, -distance]], rim])
    after = np.roll(np.arange(count), -1)
    faces = np.stack([np.zeros(count, np.int64), 1 + np.arange(count), 1 + after], axis=1).astype(np.int32)
    return Scene((Part(vertices, faces, add_alpha(compute_ramp(vertices[:, 0], vertices[:, 1], 2 * radius))),))


def make_mosaic(count: int, *, side: float, distance: float) -> Scene:
    """Makes a flat square of `count x count` squares of two triangles each, coloured by `compute_ramp`."""
    y, x = np.meshgrid(*2 * [np.linspace(-side / 2, side / 2, count + 1)], indexing="ij")
    vertices = np.stack([x, y, np.full_like(x, -distance)], axis=-1).reshape(-1, 3)
    faces = make_grid_faces(count + 1, count + 1).astype(np.int32)
    return Scene((Part(vertices, faces, add_alpha(compute_ramp(x, y, side).reshape(-1, 3))),))


def make_hills(triangles: int) -> Scene:
    """Makes a rolling surface of about `triangles` triangles, with slowly changing colours; 2 x 2 units, facing +z."""
    count = int(np.sqrt(triangles / 2)) + 1
    y, x = np.meshgrid(*2 * [np.linspace(-1, 1, count)], indexing="ij")
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    height = sample_noise(flat, frequency=3.0, octaves=3, seed=1)
    vertices = flat + np.stack([0 * height, 0 * height, 0.3 * height], axis=1)
    colors = np.stack([sample_noise(flat, frequency=2.0, seed=seed) for seed in (2, 3, 4)], axis=1)
    return Scene((Part(vertices, make_grid_faces(count, count).astype(np.int32), add_alpha(0.5 + 0.4 * colors)),))
