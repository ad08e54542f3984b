"""The scene that a light field shows, as coloured triangles in the coordinates of its lens array.

The views of a lens array are parallel projections: a pixel and its disparity m give a point at the distance
`m * pitch / delta` from the array, on the pixel's ray. The centre view gives most of the surface, and the views in the
corners of the grid add what only they see. Where the views show a background, no surface may hide it (`hull`). The
colours are those with which the model is nearest to all views (`colors`). For a camera array of known geometry the
model is then placed in front of the cameras (`cameras`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress, report_finished
from ciir.renderer.focus.disparity import check_views, estimate_disparity
from ciir.renderer.focus.model.cameras import check_cameras, place_before_cameras
from ciir.renderer.focus.model.colors import fit_colors
from ciir.renderer.focus.model.coverage import clear_rim, find_coverage, read_picture
from ciir.renderer.focus.model.hull import explains_views, find_share, find_shown, lies_in_hull
from ciir.renderer.focus.model.patch import make_patch
from ciir.renderer.focus.stereo.notes import note_reach
from ciir.renderer.focus.stereo.search_range import find_limits
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.focus.depth_scale import DepthScale
    from ciir.renderer.focus.disparity import DisparityMap
    from ciir.renderer.light_field import LightField
    from ciir.renderer.views import View

BEFORE_BACKGROUND = 40.0
"""8-bit levels that a disparity costs a pixel if all views see background behind it."""
LEAST_BACKGROUND = 0.05
"""Share of all pixels that show background; fewer, such as the dark corners of a camera's views, count as surface."""
FARTHER = 0.5
"""How much farther content that the centre view does not see may lie, as a share of that view's range of
disparities."""
DETAIL = 2
"""Known depths for each pixel of a view, along each side: outlines are then right to a quarter of a pixel."""
DISPARITY_SCALE = (
    "z is in proportion to disparity, for a camera array to 1 / distance, not to distance; for true depths and widths "
    "give camera_pitch, focal_length and the width of the sensor (in Python cameras=)"
)
"""Note about the model of a camera array of unknown geometry."""


@dataclass(frozen=True, eq=False)
class Model:
    """Triangles, or points alone, whose colours include the light of the scene: they are not to be lit again."""

    vertices: NDArray[np.float64]
    """`(n, 3)`, in the coordinates of the lens array (`renderer.lens_array`), or of the cameras, if they are known."""
    colors: NDArray[np.uint8]
    """`(n, 3)`, display-referred."""
    faces: NDArray[np.int32]
    """`(m, 3)`, counter-clockwise as seen from the array."""
    array: LensArray
    """Lens array whose views the light field holds; its elemental image array shows the model as it was captured,
    except in the coordinates of cameras."""
    notes: tuple[str, ...] = ()

    def scene(self) -> Scene:
        """Returns the model for the rendering backends, in its place in front of `array`."""
        colors = np.pad(self.colors / np.float32(255), ((0, 0), (0, 1)), constant_values=1).astype(np.float32)
        return Scene((Part(self.vertices, self.faces, colors),), self.notes)

    def save(self, path: str | PathLike[str], *, points: bool = False) -> None:
        """Writes the model as `.glb` or `.ply`; with `points`, its vertices alone, as `.ply`.

        Raises `InvalidOption` if `path` can't be written or has another format.
        """
        from ciir.renderer.focus.model.files import encode_model
        from ciir.renderer.writers.atomic_write import read_path, replacing

        place = read_path(path)
        data = encode_model(self, place.suffix, points=points)
        with replacing(place) as file:
            file.write(data)


def make_model(
    light_field: LightField,
    *,
    pitch: float | None = None,
    delta: float | None = None,
    cameras: DepthScale | None = None,
    keeps_background: bool = False,
    find_depth: Callable[[LensArray, View], NDArray[np.float32]] | None = None,
    progress: Progress = ignore_progress,
) -> Model:
    """Makes a model of what `light_field` shows: about four triangles per pixel, and sixteen if views show background
    or depths are known.

    `pitch`: the distance between lenses, by default 1, so that lengths are in pixels of a view. `delta`: the tangent
    from one view to the next, by default that of `renderer.lens_array`, with a note. A wrong one stretches the model
    along z, and changes no view that is rendered with the same one.

    `cameras`: for a camera array, `DepthScale.from_cameras`. The model is then to scale, in the unit of its distances:
    the origin is the middle of the cameras, which look along -z. Without it their views are taken as those of the lens
    array that shows the same: content without disparity lies in its plane, nearer content in front of it, and z is in
    proportion to disparity, not to distance, with a note.

    Surfaces are cut where the disparity jumps so far from one pixel to the next that the farther half of the views on
    one side would not see what lies between. Without `keeps_background`, pixels that are black or transparent and
    joined to the picture's border by others are not surface, if they are over `LEAST_BACKGROUND` of all pixels. Colours
    of 16-bit views that use fewer bits are as bright as if they used all. `progress` counts the views that the surface
    is made from: the centre and the corners.

    `find_depth`: for views rendered on black, the depth of a view of a finer lens array, `(rows, cols)`, as that of
    `Backend.render_depth`. The model then has these depths in place of estimated ones, and nothing where they are
    infinite.

    Raises `InvalidOption` for a single view, if there is nothing but background or no depth is finite, for `cameras`
    that don't fit the disparities, and for `cameras` together with `pitch` or `delta`.
    """
    if cameras is not None:
        check_cameras(cameras)
        if pitch is not None or delta is not None:
            raise InvalidOption("cameras: pitch and delta are those of a lens array; leave them out, or cameras")
    model = _make_before_lenses(
        light_field, pitch, delta, keeps_background=keeps_background, find_depth=find_depth, progress=progress
    )
    note = f"delta: unknown and assumed to be {model.array.delta:.4g}; it sets the model's length along z"
    is_known = cameras is not None or (delta and light_field.depth_sense == "lenses")
    if cameras is not None:
        model = place_before_cameras(model, cameras, light_field.depth_sense, light_field.pixel_aspect)
    elif light_field.depth_sense == "cameras":
        note = DISPARITY_SCALE
    return replace(_drop_unused(model), notes=(*light_field.notes, *model.notes, *[note] * (not is_known)))


def _make_before_lenses(
    light_field: LightField,
    pitch: float | None,
    delta: float | None,
    *,
    keeps_background: bool,
    find_depth: Callable[[LensArray, View], NDArray[np.float32]] | None,
    progress: Progress,
) -> Model:
    """Makes the model in the coordinates of a lens array."""
    from trimesh.remesh import subdivide

    field = _prepare_views(light_field)
    check_views(field.views)
    count_v, count_u, rows, cols, _ = field.shape
    array = LensArray(rows, cols, count_v, count_u, 1.0 if pitch is None else pitch, delta or 0.0)
    detail = 1 if find_depth is None else DETAIL
    fine = array.refine(detail)
    is_shown = np.ones(field.shape[:4], bool) if keeps_background or find_depth is not None else find_shown(field)
    has_background = 1 - is_shown.mean() > LEAST_BACKGROUND
    is_shown |= not has_background
    coverage = find_coverage(field, is_shown) if has_background else None
    center = center_view(count_v, count_u)
    most = 1 / (max(count_v - 1 - center[0], count_u - 1 - center[1]) // 2 + 1)  # in view k a gap is 1 - k * jump wide
    corners = [(v, u) for v in dict.fromkeys((0, count_v - 1)) for u in dict.fromkeys((0, count_u - 1))]

    def cost(view: View, disparity: float) -> NDArray[np.float32]:
        return BEFORE_BACKGROUND * find_share(is_shown, view, disparity)

    model: Model | None = None
    notes: tuple[str, ...] = ()
    limits: tuple[float, float] | None = None
    for view in report_finished(dict.fromkeys([center, *corners]), progress):
        disparity = None if find_depth is None else _to_disparity(find_depth(fine, view), fine)
        is_used = is_seen = is_shown[view] if disparity is None else np.isfinite(disparity)
        if model is not None:
            shown = _render_disparity(model, fine, view)
            is_missing = np.isinf(shown) if disparity is None else shown > disparity + most
            is_used = is_seen & _grow(is_seen & is_missing)
        if not is_used.any():
            continue
        if disparity is None:
            mapped = _estimate(field, view, limits, partial(cost, view) if has_background else None)
            notes = notes if limits else mapped.notes
            limits = limits or (float(mapped.planes[0]), float(mapped.planes[-1]))
            disparity = mapped.disparity
        is_lit = np.logical_or.reduce(is_seen.reshape(rows, detail, cols, detail), axis=(1, 3))
        picture = clear_rim(read_picture(field.views[view]), is_lit).repeat(detail, axis=0).repeat(detail, axis=1)
        patch = make_patch(picture, disparity, is_used, most)
        vertices = _place(patch.x, patch.y, patch.disparity, fine, view)
        colors, faces = patch.colors, patch.faces
        if coverage is not None:
            both, faces = subdivide(np.concatenate([vertices, colors], axis=1), faces)
            vertices, colors = both[:, :3], both[:, 3:]
            faces = faces[lies_in_hull(vertices[faces].mean(axis=1), coverage, array)]
        found = Model(vertices, (colors + 0.5).astype(np.uint8), faces.astype(np.int32), array)
        model = found if model is None else _join(model, found)
    if model is not None and len(model.faces) and has_background:
        model = replace(model, faces=model.faces[explains_views(model.scene(), field, is_shown, array)])
    if model is None or not len(model.faces):
        raise InvalidOption(
            "the views show nothing but background, which is black or transparent and reaches their borders; give "
            "views of something brighter or views with alpha, or in Python keeps_background"
            if find_depth is None
            else "no view shows any of the mesh with an alpha of 0.5 or more; give another rotate, zoom or place, or, "
            "for a see-through mesh, its elemental image array"
        )
    fitted = fit_colors(model.scene(), field, array, skips_rim=find_depth is not None)
    colors = np.broadcast_to(fitted + np.float32(0.5), model.colors.shape)
    return replace(model, colors=colors.astype(np.uint8), notes=notes)


def _prepare_views(light_field: LightField) -> LightField:
    """Returns the light field of a lens array, with levels that use all bits if they have 16."""
    unused = count_unused_bits(light_field.views)
    field = light_field.with_depth_sense("lenses")
    return replace(field, views=raise_levels(field.views, unused))


def _estimate(
    field: LightField,
    view: View,
    limits: tuple[float, float] | None,
    extra: Callable[[float], NDArray[np.float32]] | None,
) -> DisparityMap:
    """Estimates the disparity of a view. `limits`: those of the centre view; None to find them for it."""
    # Something nearer would hide what the centre view sees, but it hides what is farther.
    beyond = FARTHER if extra and limits else 0.0
    searched = limits or find_limits(field.views, corners=False)
    mapped = estimate_disparity(field, view, limits=searched, beyond=beyond, extra=extra, clips=False, order=1)
    return replace(mapped, notes=(*note_reach(searched, field.shape[2:4]), *mapped.notes))


def _render_disparity(model: Model, array: LensArray, view: View) -> NDArray[np.float32]:
    """Returns the disparity of what `view` shows of the model, `(rows, cols)`, +inf for nothing."""
    from ciir.renderer.backends import open_backend

    rays = array.rows * array.cols
    backend, _ = open_backend("raytrace", triangles=len(model.faces), rays=rays, is_see_through=False)
    (depth,) = backend.render_depth(model.scene(), array, [view])
    return _to_disparity(depth, array)


def _to_disparity(depth: NDArray[np.float32], array: LensArray) -> NDArray[np.float32]:
    return depth * np.float32(array.delta / array.pitch)


def _grow(is_there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grows the mask by the eight pixels around each: surfaces then overlap, without gaps that let light through."""
    grown: NDArray[np.bool_] = ndimage.binary_dilation(is_there, np.ones((3, 3)))
    return grown


def _place(
    x: NDArray[np.float64], y: NDArray[np.float64], disparity: NDArray[np.float64], array: LensArray, view: View
) -> NDArray[np.float64]:
    """Returns the points `(n, 3)` that `view` shows at pixels `(y, x)` with a disparity."""
    distance = disparity * array.pitch / array.delta
    across = (x - (array.cols - 1) / 2) * array.pitch + array.tangent_x()[view[1]] * distance
    up = ((array.rows - 1) / 2 - y) * array.pitch + array.tangent_y()[view[0]] * distance
    return np.stack([across, up, -distance], axis=1)


def _join(first: Model, second: Model) -> Model:
    return replace(
        first,
        vertices=np.concatenate([first.vertices, second.vertices]),
        colors=np.concatenate([first.colors, second.colors]),
        faces=np.concatenate([first.faces, second.faces + np.int32(len(first.vertices))]),
    )


def _drop_unused(model: Model) -> Model:
    """Returns the model without vertices that no triangle uses."""
    used, faces = np.unique(model.faces, return_inverse=True)
    return replace(
        model, vertices=model.vertices[used], colors=model.colors[used], faces=faces.reshape(-1, 3).astype(np.int32)
    )
