"""Where surfaces can lie: not in front of background that views show (the visual hull: Laurentini, PAMI 16, 1994)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.renderer.backends.embree import PreparedScene
from ciir.renderer.backends.raytrace import list_rays
from ciir.renderer.focus.stereo.sweep import find_overlap, read_levels
from ciir.renderer.levels import drop_alpha
from ciir.renderer.views import spread_indices

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.light_field import LightField
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

VIEWS = 9
"""Most views along v and along u that count."""
SHARE = 0.2
"""Share of those views in which a triangle may lie in front of the background: disparities are not exact."""
COVERED = 0.25
"""Coverage of a view, between its pixels, below which it sees background: with 0.5, triangles at outlines are lost."""


def find_shown(field: LightField) -> NDArray[np.bool_]:
    """Returns where the views show no background, `(V, U, H, W)`: background is black or transparent, and joined to the
    picture's border.
    """
    views = field.views
    levels = views[..., -1:] if field.is_transparent() else drop_alpha(views)
    is_empty: NDArray[np.bool_] = levels.max(axis=4) == 0
    is_shown: NDArray[np.bool_] = np.ones(views.shape[:4], bool)
    for v, u in np.ndindex(views.shape[:2]):
        labels, _ = ndimage.label(np.pad(is_empty[v, u], 1, constant_values=True), np.ones((3, 3)))
        is_shown[v, u] = labels[1:-1, 1:-1] != labels[0, 0]
    return is_shown


def find_share(is_shown: NDArray[np.bool_], view: View, disparity: float) -> NDArray[np.float32]:
    """Returns the share of views that would see background behind each pixel of `view`, `(H, W)`, at a disparity."""
    height, width = is_shown.shape[2:]
    share = np.zeros((height, width), np.float32)
    views = list(_list_views(is_shown))
    for v, u in views:
        down, across = (round(-disparity * (other - own)) for other, own in zip((v, u), view, strict=True))
        (to_y, from_y), (to_x, from_x) = find_overlap(height, down), find_overlap(width, across)
        share[to_y, to_x] += ~is_shown[v, u, from_y, from_x]
    return share / np.float32(max(len(views), 1))


def lies_in_hull(points: NDArray[np.float64], coverage: NDArray[np.float32], array: LensArray) -> NDArray[np.bool_]:
    """Returns whether few enough views see background where the points `(n, 3)` lie, `(n,)`.

    `coverage`, `(V, U, H, W)`: how much of each pixel shows no background, from 0 to 1.
    """
    before = np.zeros(len(points))
    views = list(_list_views(coverage > 0))
    for v, u in views:
        x = (points[:, 0] + array.tangent_x()[u] * points[:, 2]) / array.pitch + (array.cols - 1) / 2
        y = (array.rows - 1) / 2 - (points[:, 1] + array.tangent_y()[v] * points[:, 2]) / array.pitch
        before += ndimage.map_coordinates(coverage[v, u], [y, x], order=1, mode="nearest") < COVERED
    is_inside: NDArray[np.bool_] = before <= SHARE * len(views)
    return is_inside


def explains_views(scene: Scene, field: LightField, is_shown: NDArray[np.bool_], array: LensArray) -> NDArray[np.bool_]:
    """Returns whether each triangle of `scene`, with its neighbours, is nearer to the views' colours than black,
    `(m,)`.

    An outline then runs where it is best over all views, within a pixel. Pixels that are not beside background count
    only for a triangle.
    """
    prepared = PreparedScene(scene)
    colors = 255 * prepared.colors[:, :3]
    gain = np.zeros(len(prepared.faces))
    for view in _list_views(is_shown):
        picture = read_levels(field.views[view]) * is_shown[view]
        levels = picture.reshape(len(picture), -1).T  # (H * W, C)
        is_inner = ndimage.binary_erosion(is_shown[view], np.ones((3, 3)), border_value=1).ravel()
        for rays, origins, direction in list_rays(array, [view]):
            triangle, weights = prepared.meet(origins, direction)
            hit = np.flatnonzero(triangle >= 0)
            own = np.einsum("nk,nkc->nc", weights[hit], colors[prepared.faces[triangle[hit]]])
            seen = levels[rays][hit]
            less = np.square(seen).mean(axis=1) - np.square(seen - own).mean(axis=1)
            less[is_inner[rays][hit] & (less < 0)] = 0  # dark content is no background
            gain += np.bincount(triangle[hit], less, len(gain))
    around = np.bincount(prepared.faces.ravel(), np.repeat(gain, 3), len(colors))
    is_better: NDArray[np.bool_] = around[prepared.faces].sum(axis=1) >= 0
    return is_better


def _list_views(is_shown: NDArray[np.bool_]) -> Iterator[View]:
    """Lists the views that count: spread over the grid, with some background."""
    rows, cols = (spread_indices(0, n, VIEWS) for n in is_shown.shape[:2])
    return ((int(v), int(u)) for v in rows for u in cols if not is_shown[v, u].all())
