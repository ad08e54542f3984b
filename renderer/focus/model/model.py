"""The scene that a light field shows, as coloured triangles in the coordinates of its lens array.

The views of a lens array are parallel projections: a pixel and its disparity m give a point at the distance
`m * pitch / delta` from the array, on the pixel's ray. The centre view gives most of the surface, and the views in the
corners of the grid what only they see. Where the views show a background, no surface may hide it (the visual hull:
Laurentini, PAMI 16, 1994).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.errors import InvalidOption
from ciir.renderer.focus.disparity import estimate_disparity
from ciir.renderer.focus.model.patch import make_patch
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.views import View

HULL_VIEWS = 9
"""Views along v and along u whose background is held free, at most."""
HULL_SHARE = 0.2
"""Share of those views in which a triangle may lie before the background: disparities are not exact."""


@dataclass(frozen=True, eq=False)
class Model:
    """Triangles, or points alone, whose colours hold the light of the scene: they are not to be lit again."""

    vertices: NDArray[np.float64]
    """`(n, 3)`, in the coordinates of the lens array (`renderer.lens_array`)."""
    colors: NDArray[np.uint8]
    """`(n, 3)`, display-referred."""
    faces: NDArray[np.int32]
    """`(m, 3)`, counter-clockwise as seen from the array."""
    array: LensArray
    """Whose views the light field holds; its elemental image array shows the model as it was captured."""
    notes: tuple[str, ...] = ()

    def scene(self) -> Scene:
        """The model for the rendering backends, in place before `array`."""
        colors = np.pad(self.colors / np.float32(255), ((0, 0), (0, 1)), constant_values=1).astype(np.float32)
        return Scene((Part(self.vertices, self.faces, colors),), self.notes)

    def save(self, path: str | PathLike[str], *, points: bool = False) -> None:
        """Writes the model as `.glb` or `.ply`; with `points` its vertices alone, as `.ply`.

        Raises `InvalidOption` where `path` can't be written or its format is another one.
        """
        from ciir.renderer.focus.model.files import encode_model
        from ciir.renderer.writers.atomic_write import replacing

        data = encode_model(self, Path(path).suffix, points=points)
        with replacing(Path(path)) as file:
            file.write(data)


def make_model(
    light_field: LightField, *, pitch: float | None = None, delta: float | None = None, keeps_background: bool = False
) -> Model:
    """The model of what `light_field` shows, of one vertex and four triangles a pixel, about.

    `pitch`: between lenses, by default 1, so that lengths are in pixels of a view; `delta`: the tangent from one view
    to the next, by default that of `renderer.lens_array`, with a note. A wrong one stretches the model along z, and
    changes no view that the same one renders. Views of a camera array are taken as those of the lens array that shows
    the same: what has no disparity lies in its plane, what is nearer before it; along z the model is then to scale as
    disparities are, not as distances.

    Surfaces are cut where the disparity jumps so far from one pixel to the next that the farther half of the views on
    one side would not see what lies between. `keeps_background`: otherwise pixels that are black, or transparent, and
    joined to the picture's border by others are no surface.

    Raises `InvalidOption` for a single view and where nothing but background is there.
    """
    from ciir.renderer.backends import open_backend

    field = light_field.with_depth_sense("lenses")
    count_v, count_u, rows, cols, _ = field.shape
    array = LensArray(rows, cols, count_v, count_u, 1.0 if pitch is None else pitch, delta or 0.0)
    is_shown = np.ones(field.shape[:4], bool) if keeps_background else _find_shown(field)
    center = center_view(count_v, count_u)
    most = 1 / (max(count_v - 1 - center[0], count_u - 1 - center[1]) // 2 + 1)  # in view k it is 1 - k * jump wide
    corners = [(v, u) for v in dict.fromkeys((0, count_v - 1)) for u in dict.fromkeys((0, count_u - 1))]
    model: Model | None = None
    limits: tuple[float, float] | None = None
    for view in dict.fromkeys([center, *corners]):
        is_used: NDArray[np.bool_] = is_shown[view]
        if model is not None:
            backend, _ = open_backend("raytrace", triangles=len(model.faces), rays=rows * cols, is_see_through=False)
            (depth,) = backend.render_depth(model.scene(), array, [view])
            is_used = is_used & ~np.isfinite(depth)
        if not is_used.any():
            continue
        mapped = estimate_disparity(field, view, limits=limits)
        limits = float(mapped.planes[0]), float(mapped.planes[-1])  # of the centre view for all
        patch = make_patch(_read_picture(field.views[view]), mapped.disparity, is_used, most)
        vertices = _place(patch.x, patch.y, patch.disparity, array, view)
        faces = patch.faces[_lies_in_hull(vertices[patch.faces].mean(axis=1), is_shown, array)].astype(np.int32)
        found = Model(vertices, (patch.colors + 0.5).astype(np.uint8), faces, array)
        model = found if model is None else _join(model, found)
    if model is None or not len(model.faces):
        raise InvalidOption("model: the views show nothing but background; keep it, or give views of a scene")
    notes = () if delta else (f"delta: unknown and taken as {array.delta:.4g}, which sets the model's length along z",)
    return replace(_drop_unused(model), notes=(*light_field.notes, *notes))


def _read_picture(view: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float64]:
    """RGB of a view of any channels, `(H, W, 3)`, from 0 to 255."""
    colours = view[..., :1] if view.shape[2] < 3 else view[..., :3]
    return np.broadcast_to(colours / (np.iinfo(view.dtype).max / 255), (*view.shape[:2], 3))


def _find_shown(field: LightField) -> NDArray[np.bool_]:
    """Where the views show no background, `(V, U, H, W)`."""
    views = field.views
    levels = views[..., -1:] if field.is_transparent() else views[..., : 1 if views.shape[4] < 3 else 3]
    is_empty: NDArray[np.bool_] = levels.max(axis=4) == 0
    is_shown: NDArray[np.bool_] = np.ones(views.shape[:4], bool)
    for v, u in np.ndindex(views.shape[:2]):
        labels, _ = ndimage.label(np.pad(is_empty[v, u], 1, constant_values=True), np.ones((3, 3)))
        is_shown[v, u] = labels[1:-1, 1:-1] != labels[0, 0]
    return is_shown


def _place(
    x: NDArray[np.float64], y: NDArray[np.float64], disparity: NDArray[np.float64], array: LensArray, view: View
) -> NDArray[np.float64]:
    """The points `(n, 3)` that `view` shows at pixels `(y, x)` with a disparity."""
    distance = disparity * array.pitch / array.delta
    across = (x - (array.cols - 1) / 2) * array.pitch + array.tangent_x()[view[1]] * distance
    up = ((array.rows - 1) / 2 - y) * array.pitch + array.tangent_y()[view[0]] * distance
    return np.stack([across, up, -distance], axis=1)


def _lies_in_hull(points: NDArray[np.float64], is_shown: NDArray[np.bool_], array: LensArray) -> NDArray[np.bool_]:
    """Whether few enough views see background where the points `(n, 3)` lie, `(n,)`."""
    before = np.zeros(len(points))
    rows, cols = (np.unique(np.linspace(0, n - 1, HULL_VIEWS).round().astype(int)) for n in is_shown.shape[:2])
    views = [(v, u) for v in rows for u in cols if not is_shown[v, u].all()]
    for v, u in views:
        x = (points[:, 0] + array.tangent_x()[u] * points[:, 2]) / array.pitch + (array.cols - 1) / 2
        y = (array.rows - 1) / 2 - (points[:, 1] + array.tangent_y()[v] * points[:, 2]) / array.pitch
        share = ndimage.map_coordinates(is_shown[v, u].astype(np.float32), [y, x], order=1, mode="nearest")
        before += share < 0.5
    is_inside: NDArray[np.bool_] = before <= HULL_SHARE * len(views)
    return is_inside


def _join(first: Model, second: Model) -> Model:
    return replace(
        first,
        vertices=np.concatenate([first.vertices, second.vertices]),
        colors=np.concatenate([first.colors, second.colors]),
        faces=np.concatenate([first.faces, second.faces + np.int32(len(first.vertices))]),
    )


def _drop_unused(model: Model) -> Model:
    """The model without vertices that no triangle uses."""
    used, faces = np.unique(model.faces, return_inverse=True)
    return replace(
        model, vertices=model.vertices[used], colors=model.colors[used], faces=faces.reshape(-1, 3).astype(np.int32)
    )
