"""Makes pictures for the panel of an integral display."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from ciir.renderer.backends.progress import ignore_progress, run_parts
from ciir.renderer.displays.interpolation import interpolate_views, weigh_neighbours
from ciir.renderer.displays.light_fields import reduce_views
from ciir.renderer.sampling import DISPLAY_SAMPLES, check_samples

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.displays.integral import IntegralDisplay
    from ciir.renderer.displays.rays import RayCaster
    from ciir.renderer.readers.pictures import Pixels

Conversion = Literal["spoc", "none"]
"""spoc: lenses show the scene with its own depth (orthoscopic), by the smart pseudoscopic-to-orthoscopic conversion of
Navarro et al., Opt. Express 18, 25573 (2010). none: each lens shows what it would pick up, which a viewer sees with
inverted depth (pseudoscopic)."""
MOST_DIRECTIONS = 64
"""Most directions along each axis that are interpolated with disparity; between these, neighbours are blended."""


def render_panel(
    caster: RayCaster,
    display: IntegralDisplay,
    *,
    conversion: Conversion = "spoc",
    samples: int = DISPLAY_SAMPLES,
    progress: Progress = ignore_progress,
) -> NDArray[np.uint8]:
    """Returns the panel's picture `(height, width, 3)` of a mesh in the display's coordinates, millimetres.

    Each subpixel has the colour of the first surface on its line from the viewer through its lens's centre, or the mean
    over `samples x samples` such lines, spread over the area of the pixel around it: the panel's angular limit.

    Raises `InvalidOption` if `samples` is out of range.
    """
    check_samples(samples)
    steps = ((np.arange(samples) + 0.5) / samples - 0.5) * display.tangent_step
    around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 1, 2)
    panel = np.empty((display.height, display.width, 3), np.uint8)

    def make(row: int) -> None:
        lens, tangent = display.trace_row(row)  # (width, 3, 2)
        tangents = (tangent if conversion == "spoc" else -tangent) + around  # (samples^2, width, 3, 2)
        points = np.zeros((*tangents.shape[:3], 3))
        points[..., :2] = lens
        directions = np.full(points.shape, -1.0)
        directions[..., :2] = tangents
        colors = caster.cast_lines(points.reshape(-1, 3), directions.reshape(-1, 3)).reshape(points.shape)
        # Each ray gives the colour of its subpixel.
        panel[row] = np.rint(np.diagonal(colors, axis1=2, axis2=3).mean(axis=0))

    run_parts(make, display.height, progress)
    return panel


def resample_panel(
    views: Pixels,
    display: IntegralDisplay,
    *,
    conversion: Conversion = "spoc",
    disparity: float = 0.0,
    pixel_aspect: float = 1.0,
    beyond: NDArray[np.float64] | None = None,
    progress: Progress = ignore_progress,
) -> Pixels:
    """Returns the panel's picture `(height, width, 3)` of a light field.

    `views`: `(V, U, h, w, c)`, grey or RGB, from a camera array: v from the top, u from the left. The whole of a view
    fits into the panel, and all views together fit into the angles that a lens shows. Content that has `disparity`, in
    pixels from view to view, lies in the plane of the lenses: the reference plane of SPOC. If lenses show more
    directions than there are views, views between them are interpolated. The panel is black around the views.
    `pixel_aspect`: as in `LightField`. `beyond`: `(height,)`, receives for each row the share of subpixels that look in
    directions beyond those of all views, along axes with several views; they get the outermost view.
    """
    reduced_y, reduced_x = _find_factors(views.shape[2:4], display, pixel_aspect)
    views = reduce_views(views, (reduced_y, reduced_x)) if max(reduced_y, reduced_x) > 1 else views
    size_v, size_u, height, width, channels = views.shape
    # Millimetres in a pixel of a view.
    scale_y, scale_x = display.fit_views((height, width), pixel_aspect * reduced_x / reduced_y)
    cut = display.lens_pitch / 2  # a lens cut by the border of the views shows the border
    step = 2 * display.tangent_range / max(size_v, size_u)
    dense = _fill_directions(views, min(MOST_DIRECTIONS, math.ceil(display.lens_pitch / display.pixel_pitch - 1e-6)))
    dense_v, dense_u = dense.shape[:2]
    # Movement of content in the reference plane from one view to the next.
    drift_v = disparity * pixel_aspect / reduced_y * (size_v - 1) / max(dense_v - 1, 1)
    drift_u = disparity / reduced_x * (size_u - 1) / max(dense_u - 1, 1)
    reach = np.array([count / 2 + 1e-6 if count > 1 else np.inf for count in (size_u, size_v)])  # views
    panel = np.empty((display.height, display.width, 3), views.dtype)
    channel = np.arange(3) if channels >= 3 else np.zeros(3, np.intp)

    def make(row: int) -> None:
        lens, tangent = display.trace_row(row)  # (panel width, 3, 2)
        turn = (tangent if conversion == "spoc" else -tangent) / step
        if beyond is not None:
            beyond[row] = (np.abs(turn) > reach).any(axis=-1).mean()
        # A line that rises away from the viewer belongs to a camera below, one to the right to a camera at the left.
        x, y = (width - 1) / 2 + lens[..., 0] / scale_x, (height - 1) / 2 - lens[..., 1] / scale_y
        total = np.zeros(x.shape)
        for in_v, of_v in weigh_neighbours(_find_index(turn[..., 1], size_v, dense_v), dense_v):
            for in_u, of_u in weigh_neighbours(_find_index(-turn[..., 0], size_u, dense_u), dense_u):
                for in_y, of_y in weigh_neighbours(y - (in_v - (dense_v - 1) / 2) * drift_v, height):
                    for in_x, of_x in weigh_neighbours(x - (in_u - (dense_u - 1) / 2) * drift_u, width):
                        total += of_v * of_u * of_y * of_x * dense[in_v, in_u, in_y, in_x, channel]
        is_inside = (np.abs(x - (width - 1) / 2) <= width / 2 + cut / scale_x) & (
            np.abs(y - (height - 1) / 2) <= height / 2 + cut / scale_y
        )
        panel[row] = np.rint(np.where(is_inside, total, 0))

    run_parts(make, display.height, progress)
    return panel


def _find_index(place: NDArray[np.float64], count: int, filled: int) -> NDArray[np.float64]:
    """Returns the index in `filled` views for the place, from the centre, in `count` views of the same extent."""
    return place * ((filled - 1) / max(count - 1, 1)) + (filled - 1) / 2


def _fill_directions(views: Pixels, count: int) -> Pixels:
    """Returns the views with interpolated ones between them: `count` along each axis that has fewer, but more than
    one.
    """
    size_v, size_u = views.shape[:2]
    if 1 < size_u < count:
        wide = np.empty((size_v, count, *views.shape[2:]), views.dtype)
        for v in range(size_v):
            wide[v] = interpolate_views(views[v], count)
        views = wide
    if 1 < size_v < count:  # content moves along y, so the pictures are transposed
        high = np.empty((count, *views.shape[1:]), views.dtype)
        for u in range(views.shape[1]):
            high[:, u] = interpolate_views(views[:, u].transpose(0, 2, 1, 3), count).transpose(0, 2, 1, 3)
        views = high
    return views


def _find_factors(size: tuple[int, int], display: IntegralDisplay, pixel_aspect: float) -> tuple[int, int]:
    """Returns how many rows and columns of pixels of views of `size` (height, width) share a lens, at least 1."""
    rows, columns = (int(display.lens_pitch / scale + 1e-9) for scale in display.fit_views(size, pixel_aspect))
    return max(1, min(rows, size[0])), max(1, min(columns, size[1]))
