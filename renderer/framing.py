"""Placement of a scene in front of the lens array."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene

FILL = 0.94
"""Share of the array's width or height that the object takes up, over all views."""
CLEARANCE = 0.05
"""Distance from the array to the object's nearest point, as a share of the object's longest side."""


def frame_scene(scene: Scene, array: LensArray) -> NDArray[np.float64]:
    """The 4x4 matrix that puts `scene` in front of `array`, as large as fits into every view.

    The object keeps its orientation (y up, its +z side towards the array), and its bounding box is centred on the
    array's axis. A point at distance d appears displaced by -t*d along tangent t: `|x| + t * d <= FILL * width / 2` for
    every vertex and the outermost view's t, likewise for y.
    """
    low, high = scene.bounds()
    middle = (low + high) / 2
    gap = CLEARANCE * float((high - low).max())
    reach_x = np.abs(array.tangent_x()).max()
    reach_y = np.abs(array.tangent_y()).max()
    swept_x = swept_y = 0.0
    for part in scene.parts:
        used = part.used_vertices()  # (n, 3)
        distance = high[2] - used[:, 2] + gap
        swept_x = max(swept_x, float((np.abs(used[:, 0] - middle[0]) + reach_x * distance).max()))
        swept_y = max(swept_y, float((np.abs(used[:, 1] - middle[1]) + reach_y * distance).max()))
    # A flat object seen edge-on has no extent along one side, which then sets no limit.
    limits = [side / swept for side, swept in ((array.width, swept_x), (array.height, swept_y)) if swept > 0]
    scale = FILL / 2 * min(limits, default=min(array.width, array.height) / (2 * gap))
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = -scale * np.array([middle[0], middle[1], high[2] + gap])
    return matrix
