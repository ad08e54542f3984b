"""Ray casting in float64, without an acceleration structure: the reference for both rendering backends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends.textures import sample_texture

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.renderer.scene import Scene

    Values = NDArray[np.float64]
    Sight = Callable[[Values, Values], Values]
    """Origins `(n, 3)` and the one direction `(3,)` of all -> RGBA of what their lines hit, in levels of 8 bits, RGB
    times alpha, `(n, 4)`; 0 for nothing."""

_ON_AN_EDGE = 1e-12
"""How far outside a triangle a ray still hits it, as a share of its size: else rays would pass between triangles."""


def build_slow_sight(scene: Scene) -> Sight:
    """Tests every triangle whose bounding box contains the ray (Moeller and Trumbore, J. Graphics Tools 2(1), 1997)."""
    corners = np.concatenate([part.vertices[part.faces] for part in scene.parts])  # (m, 3 corners, 3)
    part_of = np.repeat(np.arange(len(scene.parts)), [len(part.faces) for part in scene.parts])  # (m,)
    first = np.cumsum([0] + [len(part.faces) for part in scene.parts])
    slack = 1e-9 * float(np.abs(corners).max())

    def find_colour(triangle: int, weights: Values) -> tuple[Values, float]:
        """Returns RGB in [0, 1] at these barycentric weights `(3,)`, and the share of the background that it hides."""
        part = scene.parts[part_of[triangle]]
        face = part.faces[triangle - first[part_of[triangle]]]
        rgba = weights @ part.colors[face].astype(np.float64)
        if part.texture is not None and part.uv is not None:
            rgba = rgba * sample_texture(part.texture, (weights @ part.uv[face].astype(np.float64))[None])[0]
        hidden = rgba[3] if part.is_see_through else rgba[3] >= (part.alpha_cutoff or 0.0)
        return np.clip(rgba[:3], 0.0, 1.0), float(hidden)

    def cast(origin: Values, direction: Values, tried: NDArray[np.intp]) -> Values:
        one, two = corners[tried, 1] - corners[tried, 0], corners[tried, 2] - corners[tried, 0]  # (k, 3)
        across = np.cross(direction, two)
        start = origin - corners[tried, 0]
        turned = np.cross(start, one)
        determinant = np.einsum("ki,ki->k", one, across)
        with np.errstate(divide="ignore", invalid="ignore"):  # edge-on triangles
            u = np.einsum("ki,ki->k", start, across) / determinant
            v = turned @ direction / determinant
            distance = np.einsum("ki,ki->k", two, turned) / determinant
            met = (u >= -_ON_AN_EDGE) & (v >= -_ON_AN_EDGE) & (u + v <= 1 + _ON_AN_EDGE)
        hits = np.flatnonzero(met)
        total, through = np.zeros(3), 1.0
        for hit in hits[np.argsort(distance[hits], kind="stable")]:
            rgb, hidden = find_colour(int(tried[hit]), np.array([1 - u[hit] - v[hit], u[hit], v[hit]]))
            total, through = total + through * hidden * rgb, through * (1 - hidden)
            if through == 0:
                break
        return np.append(total, 1 - through) * 255.0

    def sight(origins: Values, direction: Values) -> Values:
        plane = np.linalg.svd(direction[None])[2][1:]  # (2, 3): two axes across the rays
        flat = corners @ plane.T  # (m, 3 corners, 2)
        low, high = flat.min(axis=1) - slack, flat.max(axis=1) + slack
        seen = [
            cast(origin, direction, np.flatnonzero(((low <= place) & (place <= high)).all(axis=1)))
            for origin, place in zip(origins, origins @ plane.T, strict=True)
        ]
        return np.array(seen).reshape(-1, 4)

    return sight


def build_embree_sight(scene: Scene) -> Sight:
    """Returns the colours of `renderer.backends.embree` before rounding to 8 bits."""
    from ciir.renderer.backends.embree import PreparedScene

    prepared = PreparedScene(scene)

    def sight(origins: Values, direction: Values) -> Values:
        rgba, _ = prepared.cast(origins, direction)
        return rgba.astype(np.float64) * 255.0

    return sight
