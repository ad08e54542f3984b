"""Computes views from a raw lenslet picture, by sampling between its pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.errors import InvalidOption
from ciir.renderer.views import Pickup, is_turned

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.lenslet.grid import LensGrid
    from ciir.renderer.readers.pictures import Pixels


def fit_pixels(grid: LensGrid) -> int:
    """Returns the largest odd number of pixels along a side of a square that lies in every lens's cell; at least 1."""
    side = grid.pitch * (1.0 if grid.shape == "square" else 3**0.5 - 1)
    return max(1, 2 * int((side + 0.05 - 1) // 2) + 1)  # a measured pitch is not exact


def resample_views(picture: Pixels, grid: LensGrid, pixels: tuple[int, int], *, pickup: Pickup = "virtual") -> Pixels:
    """Returns the views `(pixels_v, pixels_u, rows, cols, channels)` of all lenses that lie wholly in `picture`,
    `(H, W, C)`.

    View (v, u) is the picture at each lens's centre plus `(v - (pixels_v - 1) / 2, u - (pixels_u - 1) / 2)` pixels
    along the grid's axes, or minus it for an `optical` pickup. So views are upright with respect to the grid. Samples
    come from the interpolating cubic spline, exact at whole numbers. Rows of a hexagonal grid are closer together than
    its lenses: its columns are resampled to the distance between the rows, and a spline along the rows undoes the shift
    of every other row.

    Raises `InvalidOption` if no lens lies in the picture.
    """
    rows, along = place_views(grid, picture.shape[:2], pixels)
    shift = grid.find_shift(rows)[:, None]
    lenses = along
    if grid.shape == "hexagonal":
        lenses = np.arange(np.floor(along[0] - 0.5), np.ceil(along[-1]) + 1)
    centers = grid.find_positions(rows[:, None], lenses + shift)  # (rows, lenses, 2)
    columns = np.stack(np.broadcast_arrays(np.arange(len(rows))[:, None], along - shift - lenses[0]))
    turn = -1 if is_turned(pickup) else 1
    top = np.iinfo(picture.dtype).max
    views = np.empty((*pixels, len(rows), len(along), picture.shape[2]), picture.dtype)
    for channel in range(picture.shape[2]):
        spline = ndimage.spline_filter(picture[..., channel].astype(np.float32), output=np.float32, mode="mirror")
        for v, u in np.ndindex(*pixels):
            step = turn * np.array([v - (pixels[0] - 1) / 2, u - (pixels[1] - 1) / 2]) @ grid.axes
            at = np.moveaxis(centers + step, -1, 0)
            view = ndimage.map_coordinates(spline, at, prefilter=False, mode="mirror")
            if grid.shape == "hexagonal":
                view = ndimage.map_coordinates(view, columns, mode="mirror")
            views[v, u, ..., channel] = np.rint(np.clip(view, 0, top))
    return views


def place_views(
    grid: LensGrid, size: tuple[int, ...], pixels: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Returns rows of lenses `(rows,)`, and the positions of a view's pixels along a row `(cols,)`, in pitches from
    lens (0, 0).

    They fill the largest rectangle along the grid's axes that lies in the picture together with the pixels of its
    lenses.
    """
    sine, cosine = abs(grid.axes[0, 1]), abs(grid.axes[0, 0])
    reach = np.array([[cosine, sine], [sine, cosine]]) @ (np.array(pixels) - 1)
    height, width = np.maximum(np.array(size) - reach, 1e-9)
    if min(height, width) <= 2 * sine * cosine * max(height, width):  # two corners in the middle of the long sides
        half = min(height, width) / 2
        fit = (half / cosine, half / sine) if width >= height else (half / sine, half / cosine)
    else:
        double = cosine**2 - sine**2
        fit = ((height * cosine - width * sine) / double, (width * cosine - height * sine) / double)
    middle = ((np.array(size) - 1) / 2 - np.asarray(grid.offset)) @ grid.axes.T / grid.pitch  # across, along
    step = grid.row_step
    half_height, half_width = np.array(fit) / 2 / grid.pitch + 1e-6
    rows = np.arange(np.ceil((middle[0] - half_height) / step), np.floor((middle[0] + half_height) / step) + 1)
    left, right = middle[1] - half_width, middle[1] + half_width
    if grid.shape == "hexagonal":  # between lenses of every row
        left, right = np.ceil(left) + 0.5, np.floor(right - 0.5)
    along = np.arange(np.ceil(left / step), np.floor(right / step) + 1) * step
    if not len(rows) or not len(along):
        raise InvalidOption(
            f"lens_pitch: no lens of {grid.pitch:.2f} pixels lies wholly in the picture of {size[0]}x{size[1]} pixels "
            "(rows x columns); give a smaller pitch, or fewer pixels"
        )
    return rows.astype(np.int64), along
