"""Which triangles no ray that is wanted can meet: outside every view, or between the samples of all of them.

A view's rays stand on a grid in the array's plane and are parallel, so a triangle is sheared along them onto that plane
(see `renderer.backends.projections`), and where the rectangle around its shadow holds no point of the grid, none of
that view's
rays meets it. `renderer.framing` puts the whole object into every view; so it is mostly triangles much finer than the
grid that go, as in what GPU pipelines call small primitive culling (Wihlidal, GDC 2016).
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

MAX_VIEWS = 5
"""Most views for which triangles are looked at: each takes a twentieth of the time that Embree builds in, and leaves
fewer to cull."""
MIN_TRIANGLES_PER_RAY = {"raytrace": 2, "raster": 8}
"""How many times as many triangles as rays a scene must have at least, by backend, so that enough of them go: Embree
takes longer for a triangle than OpenGL (`python -m ciir.benchmarks.skipping --only culling`)."""
SNAP = 1 / 32
"""How far OpenGL may move a vertex, samples: to the nearest of 16 steps at the coarsest (GL_SUBPIXEL_BITS >= 4)."""
ROUNDING = 16
"""Units of float32's last place, of the scene's longest side or the array's, by which vertices and rays may be off."""


def is_worthwhile(backend: str, *, triangles: int, rays: int, views: int) -> bool:
    """Whether culling a scene of `triangles` is worth it before `backend` makes `views` of `rays` samples each."""
    return views <= MAX_VIEWS and MIN_TRIANGLES_PER_RAY[backend] * views * rays <= triangles


def cull_if_worthwhile(
    scene: Scene, array: LensArray, views: Sequence[View], backend: str, *, samples: int = 1
) -> Scene:
    """What `cull_scene` leaves of a scene where that pays before `backend`, raytrace or raster; else `scene` itself."""
    rays = array.rows * array.cols * samples**2
    if not is_worthwhile(backend, triangles=scene.triangles, rays=rays, views=len(views)):
        return scene
    return cull_scene(scene, array, views, samples=samples)


def cull_scene(scene: Scene, array: LensArray, views: Sequence[View], *, samples: int = 1) -> Scene:
    """The triangles of a scene in front of `array` that some ray of `views` may meet, with `samples` along each side of
    a lens's cell; `scene` itself where no ray may meet any.

    The views stay the same to the bit: bounds are still those of the whole scene, by which backends place it. Only
    where a ray passes exactly through an edge, or meets two surfaces at exactly the same distance, what Embree says
    depends on the order in which it keeps all triangles, and so on which are there.
    """
    fine, bounds = array.refine(samples), scene.bounds()
    longest = float((bounds[1] - bounds[0]).max()) / fine.pitch
    margin = SNAP + ROUNDING * float(np.finfo(np.float32).eps) * max(longest, fine.rows, fine.cols)
    parts = []
    for part in scene.parts:
        is_met = find_met_triangles(part, fine, views, margin)
        if is_met.any():
            parts.append(part if is_met.all() else _with_faces(part, part.faces[is_met]))
    return replace(scene, parts=tuple(parts), extent=bounds) if parts else scene


def find_met_triangles(part: Part, array: LensArray, views: Sequence[View], margin: float) -> NDArray[np.bool_]:
    """`(m,)`: the triangles whose shadows' rectangles, `margin` pitches wider to each side, hold one of the array's
    lenses in one of `views`.
    """
    corners = np.ascontiguousarray(part.faces.T)  # (3, m)
    found = np.zeros(corners.shape[1], np.bool_)
    x, y, z = (np.ascontiguousarray(axis) / array.pitch for axis in part.vertices.T)  # (n,) each
    for v, u in views:
        columns = x + array.tangent_x()[u] * z + (array.cols - 1) / 2  # (n,), column 0 at 0
        rows = (array.rows - 1) / 2 - (y + array.tangent_y()[v] * z)
        found |= _holds(columns, corners, array.cols, margin) & _holds(rows, corners, array.rows, margin)
    return found


def _holds(places: NDArray[np.float64], corners: NDArray[np.int32], count: int, margin: float) -> NDArray[np.bool_]:
    """`(m,)`: whether one of 0 ... `count - 1` is between the places `(n,)` of triangles' `corners` `(3, m)`."""
    rounded = places.astype(np.float32)
    a, b, c = (rounded[some] for some in corners)
    low = np.ceil(np.minimum(np.minimum(a, b), c) - margin)
    high = np.floor(np.maximum(np.maximum(a, b), c) + margin)
    return np.asarray(np.maximum(low, 0) <= np.minimum(high, count - 1))


def _with_faces(part: Part, faces: NDArray[np.int32]) -> Part:
    """The part with these of its triangles alone, and the vertices that they use."""
    is_used = np.zeros(len(part.vertices), np.bool_)
    is_used[faces] = True
    number, kept = np.cumsum(is_used, dtype=np.int32) - 1, np.flatnonzero(is_used)
    return replace(
        part,
        vertices=part.vertices.take(kept, axis=0),
        faces=number[faces],
        colors=part.colors.take(kept, axis=0),
        uv=None if part.uv is None else part.uv.take(kept, axis=0),
    )
