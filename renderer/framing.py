"""Places a scene in front of the lens array."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.placement import AS_GIVEN
from ciir.renderer.scene import Part, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.placement import Placement
    from ciir.renderer.scene import Window

FILL = 0.94
"""Share of the array's width or height that the object takes up, over all views, with a zoom of 1."""
CLEARANCE = 0.05
"""Distance from the array to the nearest point of an object wholly behind it or in front of it, as a share of the
object's longest side."""


def frame_scene(scene: Scene, array: LensArray, placement: Placement = AS_GIVEN) -> NDArray[np.float64]:
    """Returns the 4x4 matrix that places `scene` at `array`, oriented as `placement` says and as large as fits into
    every view, times the placement's zoom, and then flattened by the placement's depth factor.

    A placement that fits the scene to nothing only turns and zooms it. A scene with a window is turned about the
    subject, and what the window shows fits into the centre view exactly.

    Otherwise the bounding box is centred on the array's axis. A point at distance d from the array, negative in front
    of it, appears displaced by -t*d along tangent t: `|x| + |t * d| <= zoom * FILL * width / 2` for every vertex and
    the outermost view's t, and likewise for y.
    """
    return flatten(_fit_scene(scene, array, placement), placement.depth_factor)


def flatten(matrix: NDArray[np.float64], depth_factor: float) -> NDArray[np.float64]:
    """Returns the 4x4 `matrix` followed by a scaling along z, about the array's plane z = 0."""
    scaled: NDArray[np.float64] = np.diag([1.0, 1.0, depth_factor, 1.0]) @ matrix
    return scaled


def _fit_scene(scene: Scene, array: LensArray, placement: Placement) -> NDArray[np.float64]:
    rotation = np.eye(4)
    rotation[:3, :3] = placement.rotation()
    if placement.fit == "none":
        return np.diag([placement.zoom] * 3 + [1.0]) @ rotation
    scene = scene.framed or scene
    if scene.window is not None:
        return _frame_window(scene.window, array, placement)
    if not np.array_equal(rotation, np.eye(4)):  # skips a copy of all vertices
        scene = scene.transform(rotation)
    low, high = scene.bounds()
    middle = (low + high) / 2
    gap = CLEARANCE * float((high - low).max())
    plane = _find_plane(low[2] - gap, high[2] + gap, placement)
    reach_x = np.abs(array.tangent_x()).max()
    reach_y = np.abs(array.tangent_y()).max()
    swept_x = swept_y = 0.0
    for part in scene.parts:
        used = part.used_vertices()  # (n, 3)
        distance = np.abs(plane - used[:, 2])
        swept_x = max(swept_x, float((np.abs(used[:, 0] - middle[0]) + reach_x * distance).max()))
        swept_y = max(swept_y, float((np.abs(used[:, 1] - middle[1]) + reach_y * distance).max()))
    # A flat object seen edge-on has no extent along one side, which then sets no limit.
    limits = [side / swept for side, swept in ((array.width, swept_x), (array.height, swept_y)) if swept > 0]
    scale = placement.zoom * FILL / 2 * min(limits, default=min(array.width, array.height) / (2 * gap))
    matrix = np.diag([scale, scale, scale, 1.0]) @ rotation
    matrix[:3, 3] = -scale * np.array([middle[0], middle[1], plane])
    return matrix


def _find_plane(low: float, high: float, placement: Placement) -> float:
    """Returns the array's plane in the object's own z: in front of its nearest point, behind its farthest, or between
    them.
    """
    return high * (1 - placement.place) / 2 + low * (1 + placement.place) / 2


def _frame_window(window: Window, array: LensArray, placement: Placement) -> NDArray[np.float64]:
    """Does the same as `_fit_scene` for what a camera sees."""
    ratios = [array.height / window.half_height]
    if window.half_width is not None:
        ratios.append(array.width / window.half_width)
    scale = placement.zoom / 2 * min(ratios)
    gap = CLEARANCE * max(window.farthest - window.nearest, 2 * window.half_height)
    plane = _find_plane(-window.farthest - gap, -window.nearest + gap, placement)
    subject = np.array([0.0, 0.0, -window.distance])
    matrix = np.eye(4)
    matrix[:3, :3] = scale * placement.rotation()
    matrix[:3, 3] = scale * (subject - (0.0, 0.0, plane)) - matrix[:3, :3] @ subject
    return matrix


def find_turn(scene: Scene, first: Placement, placement: Placement) -> NDArray[np.float64]:
    """Returns the 4x4 rotation, in the mesh's own axes, by which `placement` turns it further than `first` does. It
    turns about the middle of the mesh's bounding box, so that the mesh stays in its place.
    """
    matrix = np.eye(4)
    if placement.rotate != first.rotate:
        middle = scene.bounds().mean(axis=0)
        matrix[:3, :3] = first.rotation().T @ placement.rotation()
        matrix[:3, 3] = middle - matrix[:3, :3] @ middle
    return matrix


def find_extremes(
    scene: Scene, array: LensArray, placement: Placement, turn: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns the vertices of `scene` that alone decide how `frame_scene` frames it, `(k, 3)`, turned by the 4x4
    `turn`: those farthest along the array's axes and along the outermost rays, in both directions.
    """
    reach_x, reach_y = (float(np.abs(tangents).max()) for tangents in (array.tangent_x(), array.tangent_y()))
    x, y, z = placement.rotation()  # the array's axes in the mesh's own
    directions = np.stack([x, y, z, x + reach_x * z, x - reach_x * z, y + reach_y * z, y - reach_y * z])
    found = []
    for part in scene.parts:
        used = part.used_vertices()
        along = used @ directions.T  # (n, 7)
        found += [used[along.argmin(axis=0)], used[along.argmax(axis=0)]]
    return np.concatenate(found) @ turn[:3, :3].T + turn[:3, 3]


def make_frame(extremes: Sequence[NDArray[np.float64]], windows: Sequence[Window | None]) -> Scene:
    """Makes a scene to frame in the place of several: only points, from `find_extremes` of each, and the window that
    shows what all `windows` show.
    """
    points = np.concatenate(extremes)
    faces = np.repeat(np.arange(len(points), dtype=np.int32)[:, None], 3, axis=1)
    return Scene((Part(points, faces, np.zeros((len(points), 4), np.float32)),), window=_join(windows))


def turn_back(framed: Scene, turn: NDArray[np.float64]) -> Scene:
    """Returns a scene of `make_frame` for a mesh that its placement turns by `turn`, so that it is framed as without
    that turn.
    """
    return replace(framed.transform(np.linalg.inv(turn).astype(np.float64)), window=framed.window)


def _join(windows: Sequence[Window | None]) -> Window | None:
    """Returns the widest window, from the nearest point of all to the farthest: one camera's picture grows with the
    distance.
    """
    found = [window for window in windows if window is not None]
    if not found:
        return None
    widest = max(found, key=lambda window: (window.half_height, window.distance))
    nearest, farthest = min(window.nearest for window in found), max(window.farthest for window in found)
    return replace(widest, nearest=nearest, farthest=farthest)
