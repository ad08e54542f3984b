"""Windows of views rendered around each view of a mesh for a light-field network, at the most useful spacing.

A network gains from other views because they have samples between those of the wanted view. Views of a lens array are
often further apart than that requires: they then see around the object, and its outline is drawn too wide. With a
shallow object, or few lenses, they are too close to differ. Any view of a mesh can be rendered, so windows needn't
consist of the array's views.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.models.light_field.disparities.ranges import FARTHEST
from ciir.models.light_field.planes import Range
from ciir.models.light_field.strides import MOVED
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.renderer.lens_array import LensArray

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.placement import Placement
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

LEAST = 1 / 32
"""The least spacing."""


@dataclass(frozen=True)
class WindowArray(LensArray):
    """A lens array with a window of `WINDOW_SIDE` directions down and across around each direction of another array."""

    spacing: float = 1.0
    """Distance between the directions of a window, relative to that of the other array."""

    def tangent_x(self) -> NDArray[np.float64]:
        """Returns tx of each pixel column, window by window."""
        return self._spread(self.pixels_u)

    def tangent_y(self) -> NDArray[np.float64]:
        """Returns ty of each pixel row from the top down, window by window."""
        return -self._spread(self.pixels_v)

    def _spread(self, pixels: int) -> NDArray[np.float64]:
        count = pixels // WINDOW_SIDE
        own = np.arange(count) - (count - 1) / 2
        around = (np.arange(WINDOW_SIDE) - WINDOW_SIDE // 2) * self.spacing
        return np.asarray((own[:, np.newaxis] + around).ravel() * self.delta)


@dataclass(frozen=True)
class ViewWindows:
    """A grid of views in which each view of a lens array is at the centre of its own window."""

    spacing: float
    """The distance between neighbouring views of a window, relative to that of the array's views."""
    disparities: Range | None = None
    """The range of disparities in everything that is seen, in pixels from one view of a window to the next; None if
    some are larger than `FARTHEST`."""

    def list_grid(self, grid: View) -> View:
        """Returns the rows and columns of the grid for an array of `grid` views."""
        return WINDOW_SIDE * grid[0], WINDOW_SIDE * grid[1]

    def find_place(self, view: View) -> View:
        """Returns the place of the array's view in the grid."""
        v, u = (WINDOW_SIDE * number + WINDOW_SIDE // 2 for number in view)
        return v, u

    def refine(self, array: LensArray) -> WindowArray:
        """Returns the lens array whose views are the grid. Raises `InvalidOption` if it has too many."""
        kept = {field.name: getattr(array, field.name) for field in fields(LensArray)}
        rows, cols = self.list_grid((array.pixels_v, array.pixels_u))
        return WindowArray(**kept | {"pixels_v": rows, "pixels_u": cols}, spacing=self.spacing)


def find_view_windows(
    mesh: Scene, array: LensArray, placement: Placement, matrix: NDArray[np.float64]
) -> ViewWindows | None:
    """Finds the windows that help best, none wider than the array's range of views.

    Returns None if the frame doesn't follow from the mesh's bounds, so that it is unknown what is seen, and if the grid
    would be out of range. `matrix`: that of `frame_scene`.
    """
    if mesh.window is not None or placement.fit == "none":
        return None
    low, high = mesh.bounds()
    corners = np.array(list(product(*zip(low, high, strict=True), (1.0,))))
    moved = float(np.abs(corners @ matrix[2]).max()) * array.delta / array.pitch
    most = max(1.0, (min(array.pixels_v, array.pixels_u) - 1) / (WINDOW_SIDE - 1))
    spacing = max(LEAST, most if moved * most <= MOVED else MOVED / moved)
    found = ViewWindows(spacing, _find_disparities(mesh, array, matrix, spacing))
    try:
        found.refine(array)
    except InvalidOption:
        return None
    return found


def _find_disparities(mesh: Scene, array: LensArray, matrix: NDArray[np.float64], spacing: float) -> Range | None:
    """Returns the range of a mesh's disparities in windows of views that are `spacing` apart.

    Returns None if some are larger than `FARTHEST`. Content at `z` moves by `z * delta / pitch` pixels from one view of
    the array to the next.
    """
    depths = [part.used_vertices() @ matrix[2, :3] + matrix[2, 3] for part in mesh.parts]
    step = spacing * array.delta / array.pitch
    ends = step * min(float(depth.min()) for depth in depths), step * max(float(depth.max()) for depth in depths)
    return Range(*ends) if max(map(abs, ends)) <= FARTHEST else None
