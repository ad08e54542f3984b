"""Prepares a light field's views for a display: opaque, in camera order, in the number and shape that it shows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import TooLarge
from ciir.renderer.displays.depth_budget import describe_row
from ciir.renderer.displays.interpolation import interpolate_views, shift_rows
from ciir.renderer.displays.quilt import join_views

if TYPE_CHECKING:
    from ciir.renderer.displays.quilt import QuiltLayout
    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import DepthSense

LEAST_MISFIT = 0.01
"""Share by which aspects must differ for a note."""


def order_as_cameras(light_field: LightField) -> Pixels:
    """Returns all views, `(V, U, h, w, c)` with 1 or 3 channels, v from the uppermost camera and u from the leftmost.

    A pixel further to the right under a lens sees further to the right, as a camera further to the left does, so views
    of a lens array are taken in the opposite order. Views with alpha are placed on a black background.
    """
    views = light_field.views if light_field.depth_sense == "cameras" else light_field.views[::-1, ::-1]
    if views.shape[4] in (1, 3):
        return views
    colors = views[..., :-1]
    if not light_field.is_transparent():
        return colors
    alpha = views[..., -1:].astype(np.float32) / np.iinfo(views.dtype).max
    flat: Pixels = np.empty(colors.shape, views.dtype)
    flat[:] = np.rint(colors * alpha)
    return flat


def find_row(rows: int, depth_sense: DepthSense) -> int:
    """Returns the row of `rows` that lenticular displays show: the middle one, or the upper of the two middle ones as
    cameras see them.
    """
    return (rows - 1) // 2 if depth_sense == "cameras" else rows // 2


def take_row(cameras: Pixels, count: int, *, disparity: float = 0.0) -> tuple[Pixels, tuple[str, ...]]:
    """Returns `count` views, `(count, h, w, c)`, of the middle row of `cameras`, from the leftmost on, and notes.

    `disparity`: content that moves by this many pixels to the left from one camera to the next stays in its place.
    """
    row = cameras[(cameras.shape[0] - 1) // 2]
    total = len(row)
    notes: tuple[str, ...] = ()
    if total == 1:
        notes = ("one column of views has no horizontal parallax: all views of the display are the same",)
    elif total != count:
        is_chosen = count == 1 or (total - 1) % (count - 1) == 0
        what = "chosen among" if is_chosen else "interpolated from"
        notes = (f"{count} views are {what} the {total} of the middle row",)
    if disparity:
        shifted = np.empty_like(row)
        for u in range(total):
            moved = shift_rows(row[u].astype(np.float32), -disparity * (u - (total - 1) / 2))
            shifted[u] = np.rint(moved)
        row = shifted
    return interpolate_views(row, count), notes


def find_padded_size(size: tuple[int, int], stretch: float) -> tuple[int, int]:
    """Returns the height and width of views of `size`, with the borders that multiply their aspect by `stretch`."""
    height, width = size
    return max(height, round(height / stretch)), max(width, round(width * stretch))


def pad_to_aspect(views: Pixels, own: float, aspect: float) -> tuple[Pixels, tuple[str, ...]]:
    """Returns the views, `(n, h, w, c)`, with black borders at two sides that make their aspect `aspect`; and a
    note.

    `own`: the aspect, width / height, that they are shown with; pixels need not be square.
    """
    count, height, width, channels = views.shape
    high, wide = find_padded_size((height, width), aspect / own)
    if (wide, high) == (width, height):
        return views, ()
    padded: Pixels = np.zeros((count, high, wide, channels), views.dtype)
    top, left = (high - height) // 2, (wide - width) // 2
    padded[:, top : top + height, left : left + width] = views
    return padded, note_borders((height, width), own, aspect)


def note_borders(size: tuple[int, int], own: float, aspect: float) -> tuple[str, ...]:
    """Returns the note on the borders of views of `size`, height and width, if they get any."""
    if find_padded_size(size, aspect / own) == size:
        return ()
    return (f"black borders bring views of {size[1]}x{size[0]} pixels to the aspect {aspect:.4g}",)


def make_quilt(
    light_field: LightField,
    layout: QuiltLayout,
    *,
    own_aspect: float,
    keeps_aspect: bool,
    disparity: float = 0.0,
    max_pixels: int,
) -> tuple[Pixels, QuiltLayout, tuple[str, ...]]:
    """Returns the quilt `(height, width, 1 or 3)` of a light field's views, its layout, and notes.

    `own_aspect`: the width / height that views are shown with. With `keeps_aspect` it becomes the layout's aspect,
    otherwise the views get borders. `disparity`: as in `take_row`, in pixels of the given views. `max_pixels`: most
    pixels of the quilt; views that would exceed it are reduced by a whole factor.
    """
    cameras = order_as_cameras(light_field)
    height, width = cameras.shape[2:4]
    stretch = 1.0 if keeps_aspect else layout.aspect / own_aspect
    factor = find_reduction((height, width), layout.count, max_pixels, stretch)
    reduced: tuple[str, ...] = ()
    if factor > 1:
        cameras = reduce_views(cameras, (factor, factor))
        reduced = (f"views of {width}x{height} pixels are made {factor} times smaller",)
    row, notes = take_row(cameras, layout.count, disparity=disparity / factor)
    notes += describe_row(cameras, layout.count, disparity, factor)
    if keeps_aspect:
        if abs(own_aspect / layout.aspect - 1) > LEAST_MISFIT:
            kept = f"views keep their aspect {own_aspect:.4g}, not the device's {layout.aspect:.4g}"
            notes += (f"{kept}; name the device for black borders that fill it",)
        layout = replace(layout, aspect=own_aspect)
        return join_views(row, layout), layout, (*reduced, *notes)
    row, padded = pad_to_aspect(row, own_aspect, layout.aspect)
    return join_views(row, layout), layout, (*reduced, *notes, *padded)


def reduce_views(views: Pixels, cell: tuple[int, int]) -> Pixels:
    """Returns the means over cells of `cell` pixels, rows and columns, of `(..., h, w, c)`; rows and columns that fill
    no whole cell are cut off equally at both sides.
    """
    *grid, height, width, channels = views.shape
    high, wide = cell
    rows, cols = height // high, width // wide
    top, left = (height - rows * high) // 2, (width - cols * wide) // 2
    cells = views[..., top : top + rows * high, left : left + cols * wide, :]
    reduced: Pixels = np.empty((*grid, rows, cols, channels), views.dtype)
    for index in np.ndindex(*grid):  # one view at a time, because the means are floating-point
        reduced[index] = np.rint(cells[index].reshape(rows, high, cols, wide, channels).mean(axis=(1, 3)))
    return reduced


def find_reduction(size: tuple[int, int], count: int, most: int, stretch: float = 1.0) -> int:
    """Returns the smallest whole factor that reduces `count` views of `size` (height, width) to at most `most` pixels,
    with the borders of `find_padded_size`.

    Raises `TooLarge` if no pixel would be left of a view.
    """
    for factor in range(1, min(size) + 1):
        if count * math.prod(find_padded_size((size[0] // factor, size[1] // factor), stretch)) <= most:
            return factor
    what = f"{count} views of {size[1]}x{size[0]} pixels with borders are over {most:,} pixels even if reduced"
    raise TooLarge(f"quilt: {what}; give fewer views or another aspect", "pixels")
