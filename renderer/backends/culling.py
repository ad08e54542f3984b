"""Removes triangles that no ray of the given views can hit: outside every view, or between all its samples.

A view's rays are parallel and start on a grid in the array's plane, so a triangle is sheared along them onto that plane
(see `renderer.backends.projections`). If the rectangle around its shadow holds no point of the grid, none of the view's
rays hits the triangle: small primitive culling (Wihlidal, GDC 2016).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Part, Scene
    from ciir.renderer.views import View

FEW_VIEWS = 5
"""Most views for which culling is done: each view costs a twentieth of the time that Embree takes to build the scene,
and leaves fewer triangles to remove."""
MIN_TRIANGLES_PER_RAY = {"raytrace": 2, "raster": 8}
"""Fewest triangles per ray, by backend, at which culling is done: Embree takes longer for a triangle than OpenGL
(`python -m ciir.benchmarks.skipping --only culling`)."""
SNAP = 1 / 32
"""How far OpenGL may move a vertex, in samples: it rounds to the nearest of 16 steps at the coarsest (GL_SUBPIXEL_BITS
>= 4)."""
ROUNDING = 16
"""Rounding errors of vertices and rays, in units of float32's last place for the scene's or the array's longest
side."""


def is_worthwhile(backend: str, *, triangles: int, rays: int, views: int) -> bool:
    """Returns whether culling a scene of `triangles` saves time when `backend` renders `views` of `rays` samples."""
    return views <= FEW_VIEWS and MIN_TRIANGLES_PER_RAY[backend] * views * rays <= triangles


def cull_if_worthwhile(
    scene: Scene, array: LensArray, views: Sequence[View], backend: str, *, samples: int = 1
) -> Scene:
    """Returns the scene culled by `cull_scene` if that saves time with `backend`, raytrace or raster; else `scene`."""
    rays = array.rows * array.cols * samples**2
    if not is_worthwhile(backend, triangles=scene.triangles, rays=rays, views=len(views)):
        return scene
    return cull_scene(scene, array, views, samples=samples)


def cull_scene(scene: Scene, array: LensArray, views: Sequence[View], *, samples: int = 1) -> Scene:
    """Returns the scene with only the triangles that a ray of `views` may hit, or `scene` itself if no ray hits any.

    `samples`: point samples along each side of a lens cell. Views and bounds stay the same to the bit, except for
    Embree's result for a ray exactly through an edge, or one that hits two surfaces at exactly the same distance.
    """
    fine, bounds = array.refine(samples), scene.bounds()
    longest = float((bounds[1] - bounds[0]).max()) / fine.pitch
    margin = SNAP + ROUNDING * float(np.finfo(np.float32).eps) * max(longest, fine.rows, fine.cols)
    parts = []
    for part in scene.parts:
        is_met = find_met_triangles(part, fine, views, margin)
        if is_met.any():
            parts.append(part if is_met.all() else _keep_faces(part, part.faces[is_met]))
    return replace(scene, parts=tuple(parts), extent=bounds) if parts else scene


def find_met_triangles(part: Part, array: LensArray, views: Sequence[View], margin: float) -> NDArray[np.bool_]:
    """Returns `(m,)`: whether the rectangle around each triangle's shadow, widened by `margin` pitches on each side,
    contains one of the array's lenses in one of `views`.
    """
    corners = np.ascontiguousarray(part.faces.T)  # (3, m)
    found = np.zeros(corners.shape[1], np.bool_)
    x, y, z = (np.ascontiguousarray(axis) / array.pitch for axis in part.vertices.T)  # (n,) each
    for v, u in views:
        columns = x + array.tangent_x()[u] * z + (array.cols - 1) / 2  # (n,), column 0 at 0
        rows = (array.rows - 1) / 2 - (y + array.tangent_y()[v] * z)
        found |= _span_integer(columns, corners, array.cols, margin) & _span_integer(rows, corners, array.rows, margin)
    return found


def _span_integer(
    places: NDArray[np.float64], corners: NDArray[np.int32], count: int, margin: float
) -> NDArray[np.bool_]:
    """Returns whether one of 0 ... `count - 1` lies between the places `(n,)` of each triangle's `corners` `(3, m)`."""
    rounded = places.astype(np.float32)
    a, b, c = (rounded[corner] for corner in corners)
    low = np.ceil(np.minimum(np.minimum(a, b), c) - margin)
    high = np.floor(np.maximum(np.maximum(a, b), c) + margin)
    return np.asarray(np.maximum(low, 0) <= np.minimum(high, count - 1))


def _keep_faces(part: Part, faces: NDArray[np.int32]) -> Part:
    """Returns the part with only these of its triangles and the vertices that they use."""
    is_used = np.zeros(len(part.vertices), np.bool_)
    is_used[faces] = True
    number, kept = np.cumsum(is_used, dtype=np.int32) - 1, np.flatnonzero(is_used)
    return replace(
        part,
        vertices=part.vertices.take(kept, axis=0),
        faces=number[faces],
        colors=part.colors.take(kept, axis=0),
        back_colors=None if part.back_colors is None else part.back_colors.take(kept, axis=0),
        uv=None if part.uv is None else part.uv.take(kept, axis=0),
    )
