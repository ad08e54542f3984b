"""Fits vertex colours so that a model shows all views best, by linear least squares: a picture is linear in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage, sparse

from ciir.renderer.backends.embree import PreparedScene
from ciir.renderer.backends.raytrace import list_rays
from ciir.renderer.focus.stereo.conjugate_gradients import solve
from ciir.renderer.focus.stereo.sweep import read_levels
from ciir.renderer.views import spread_indices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.light_field import LightField
    from ciir.renderer.scene import Scene

VIEWS = 3, 15
"""Fewest and most views along v and along u that count."""
RAYS = 1 << 22
"""Most rays; with more, fewer views count. Each ray takes some 100 bytes."""
DAMPING = 0.2
"""Weight of the given colours: this share of a usual vertex's weight, squared and summed over its rays."""
STEPS = 6
"""Steps of conjugate gradients; more change no colour by a level."""


def fit_colors(scene: Scene, field: LightField, array: LensArray, *, skips_rim: bool = False) -> NDArray[np.float32]:
    """Returns the colours of the scene's vertices `(n, C)` in 8-bit levels, C = 1 or 3, that are nearest to `field`'s
    views.

    Each pixel is the colour that the ray through its middle hits, weighted among its triangle's vertices. A vertex that
    no ray hits keeps its colour. `skips_rim`: whether pixels beside those without a hit, which are partly background,
    don't count. Solved as damped least squares (Levenberg, 1944) by conjugate gradients, scaled by the diagonal.
    """
    prepared = PreparedScene(scene)
    rows, seen = [], []
    views = int(np.clip(np.sqrt(RAYS / (array.rows * array.cols)), *VIEWS))
    spread = [spread_indices(0, n, views) for n in field.shape[:2]]
    for view in ((int(v), int(u)) for v in spread[0] for u in spread[1]):
        levels = read_levels(field.views[view])
        levels = levels.reshape(len(levels), -1).T  # (H * W, C)
        met = [prepared.meet(origins, direction) for _, origins, direction in list_rays(array, [view])]
        triangle, weights = (np.concatenate(parts) for parts in zip(*met, strict=True))
        is_hit = (triangle >= 0).reshape(array.rows, array.cols)
        if skips_rim:
            is_hit = ndimage.binary_erosion(is_hit, np.ones((3, 3)), border_value=1)
        hit = np.flatnonzero(is_hit)
        places = np.arange(0, 3 * len(hit) + 1, 3)
        shape = len(hit), len(prepared.colors)
        corners = prepared.faces[triangle[hit]]
        rows.append(sparse.csr_array((weights[hit].ravel(), corners.ravel(), places), shape=shape))
        seen.append(levels[hit])
    matrix = sparse.vstack(rows, format="csr")  # (rays, n)
    levels = np.concatenate(seen)  # (rays, C)
    colors = np.float32(255) * prepared.colors[:, : levels.shape[1]]
    return np.clip(_solve(matrix, levels, colors), 0, 255)


def _solve(matrix: sparse.csr_array, levels: NDArray[np.float32], start: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the x, `(n, C)`, near `start` with the least `|matrix @ x - levels|`; all channels use the same steps."""
    transposed = matrix.T.tocsr()
    own = np.asarray(matrix.power(2).sum(axis=0), np.float32)[:, None]  # (n, 1): the diagonal of the normal equations
    damping = np.float32(DAMPING * own[own > 0].mean()) if own.any() else np.float32(1)

    def apply(x: NDArray[np.float32]) -> NDArray[np.float32]:
        image: NDArray[np.float32] = transposed @ (matrix @ x) + damping * x
        return image

    change: NDArray[np.float32] = solve(apply, transposed @ (levels - matrix @ start), own + damping, steps=STEPS)
    return start + change
