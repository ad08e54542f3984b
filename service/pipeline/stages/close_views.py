"""Views of a mesh that only help a light-field network, close to the view that they help.

What a network gains from other views are samples between those of the wanted one. Views of a lens array are often
further apart than that needs: then they see around the object, and its outline is drawn too wide. Of a mesh any view
can be rendered, so those that help lie `division` times as close to each other as the array's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.renderer.framing import frame_scene

if TYPE_CHECKING:
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.placement import Placement
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

MOVED = 0.72
"""Pixels that the farthest content best moves by from one view to the next: docs/experiments.md."""
MOST = 32
"""The largest division."""
_MARGIN = WINDOW_SIDE // 2


@dataclass(frozen=True)
class CloseViews:
    """The grid of views that has those of a lens array, `division` - 1 views between two of them, and so many around
    them that each of the array's is in the middle of its window.
    """

    division: int

    def list_grid(self, grid: View) -> View:
        """Rows and columns of the grid for an array of `grid` views."""
        rows, cols = (self.division * (count - 1) + 1 + 2 * _MARGIN for count in grid)
        return rows, cols

    def find_place(self, view: View) -> View:
        """The place in the grid of the array's view."""
        v, u = (self.division * number + _MARGIN for number in view)
        return v, u

    def refine(self, array: LensArray) -> LensArray:
        """The lens array whose views are the grid."""
        rows, cols = self.list_grid((array.pixels_v, array.pixels_u))
        return replace(array, pixels_v=rows, pixels_u=cols, delta=array.delta / self.division)


def find_close_views(mesh: Scene, array: LensArray, placement: Placement) -> CloseViews | None:
    """The views that help best; None where the array's own are close enough, where the mesh's bounds are not what is
    framed, so that what is seen isn't known, and where the refined array would be out of range.
    """
    if mesh.window is not None or placement.fit == "none":
        return None
    matrix = frame_scene(mesh, array, placement)
    low, high = mesh.bounds()
    corners = np.array(list(product(*zip(low, high, strict=True), (1.0,))))
    moved = float(np.abs(corners @ matrix[2]).max()) * array.delta / array.pitch
    division = min(round(moved / MOVED), MOST)
    if division < 2:
        return None
    found = CloseViews(division)
    try:
        found.refine(array)
    except InvalidOption:
        return None
    return found
