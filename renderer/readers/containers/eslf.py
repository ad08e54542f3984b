"""Reads Lytro's ESLF: an elemental image array of 14x14 pixels under each lens, `eslf[14*y + v, 14*x + u]`.

Lytro Desktop exports it, and the archives of Stanford and of Kalantari et al. (2016) use it. Views at the rim of the
lenses are empty. Rows and columns missing from the last lenses are filled with zeros (LFReadESLF.m of the Light Field
Toolbox). u grows to the right, as with cameras.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from ciir.renderer.light_field import LightField
from ciir.renderer.readers import names, pictures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.readers.pictures import Pixels

PIXELS = (14, 14)
LENSES = (range(375, 377), range(540, 542))
"""Rows and columns of lenses in the Lytro Illum."""
EMPTY = 0.02
"""A view is empty if its mean is below this share of that of the brightest view."""

RECOGNISED = (
    "read as Lytro's ESLF, as the corner views of its 14x14 are empty: u counts cameras from the left; arrangement eia "
    "reads it as an elemental image array of a lens array"
)
"""The note on a picture that is recognised as ESLF though neither its name nor its size shows it."""


def is_eslf(name: str, data: bytes) -> bool:
    """Returns whether a PNG is named `..._eslf.png`, or has the size of the Illum's."""
    height, width = int.from_bytes(data[20:24], "big"), int.from_bytes(data[16:20], "big")
    is_of_size = height // PIXELS[0] in LENSES[0] and width // PIXELS[1] in LENSES[1]
    return names.is_eslf(name) or is_of_size


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the views that are not empty, with lenses of `layout.pixels`, by default 14x14."""
    return select_views(_map(pictures.decode(data, name=name, max_pixels=limits.pixels), layout.pixels or PIXELS))


def has_empty_corners(views: Pixels) -> bool:
    """Returns whether `views`, all views of an elemental image array, are the 14x14 of ESLF with empty corner views.

    The round pupil of a lens doesn't reach the corners.
    """
    if views.shape[:2] != PIXELS:
        return False
    light = views[..., 3:] if views.shape[4] == 4 else views
    middle = light[PIXELS[0] // 2, PIXELS[1] // 2].mean()
    corners = light[:: PIXELS[0] - 1, :: PIXELS[1] - 1].mean(axis=(2, 3, 4))
    return bool(middle > 0 and corners.max() <= EMPTY * middle)


def select_views(views: Pixels) -> LightField:
    """Returns the light field of those `views` that are not empty; a fourth channel is their weight."""
    notes: tuple[str, ...] = ()
    weight = None
    if views.shape[4] == 4:
        weight, views = views[..., 3:], views[..., :3]
        notes += ("the fourth channel of ESLF is a weight, not alpha: it is left out",)
    sums = _sum_views(views)
    if weight is not None:  # it may be opaque everywhere
        sums[_sum_views(weight) == 0] = 0
    kept = _find_full_grid(sums)
    count_v, count_u = views.shape[:2]
    views = views[kept]
    if views.shape[:2] != (count_v, count_u):
        left = f"{views.shape[0]}x{views.shape[1]} views from ({kept[0].start}, {kept[1].start})"
        notes += (f"of the {count_v}x{count_u} views those on the margin are empty: {left} are read",)
    return LightField(views, notes, depth_sense="cameras")


def _map(picture: Pixels, pixels: tuple[int, int]) -> Pixels:
    """Returns the views of an elemental image array, padded with zeros to whole lenses."""
    height, width = picture.shape[:2]
    below, beside = -height % pixels[0], -width % pixels[1]
    whole = cast("Pixels", np.pad(picture, ((0, below), (0, beside), (0, 0)))) if below or beside else picture
    return LightField.from_eia(whole, rows=whole.shape[0] // pixels[0], cols=whole.shape[1] // pixels[1]).views


def _sum_views(views: Pixels) -> NDArray[np.uint64]:
    """Returns the sum of the samples of each view. It sums over rows of lenses first, which is the order of the picture
    in memory.
    """
    sums: NDArray[np.uint64] = views.sum(axis=2, dtype=np.uint32).sum(axis=(2, 3), dtype=np.uint64)
    return sums


def _find_full_grid(sums: NDArray[np.uint64]) -> tuple[slice, slice]:
    """Returns the grid of views that remains when rows and columns at the margin are removed until no view is empty.

    Each step removes the row or column with the largest share of empty views.
    """
    is_empty = sums <= EMPTY * sums.max()
    top, left, (bottom, right) = 0, 0, is_empty.shape
    while (grid := is_empty[top:bottom, left:right]).any() and grid.size > 1:
        rows = {"top": grid[0], "bottom": grid[-1]} if len(grid) > 1 else {}
        columns = {"left": grid[:, 0], "right": grid[:, -1]} if grid.shape[1] > 1 else {}
        sides = rows | columns
        worst = max(sides, key=lambda side: sides[side].mean())
        top, bottom = top + (worst == "top"), bottom - (worst == "bottom")
        left, right = left + (worst == "left"), right - (worst == "right")
    return slice(top, bottom), slice(left, right)
