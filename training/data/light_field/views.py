"""Light fields for validation and evaluation: their views, and low-resolution versions of these."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.errors import InputError
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.eia import reader as eia
from ciir.renderer.readers.layout import Layout
from ciir.training.data.corrupt import encode_jpeg
from ciir.training.data.downscale import Pair, downscale_picture

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

OPTION = r"\b(pixels|lenses) \S+x\S|\b(lens_pitch|crop|arrangement|order) "
"""Advice to give an option that says how views lie in a file, which recipes and `ciir export` don't have."""
LEAST = 16
"""Smallest side of a view in pixels, because its low-resolution version must be large enough to be scored."""


def read_views(
    path: Path, *, grid: tuple[int, int] | None = None, layout: Layout | None = None, keeps_grey: bool = False
) -> NDArray[np.uint8]:
    """Reads the middle `grid` = (V, U) views of a light field, by default all: `(V, U, H, W, 3)`, 8-bit RGB.

    `path`, `grid`, `layout`: as for `read_light_field`. `keeps_grey`: whether grey views keep their one channel;
    otherwise they get three equal ones. 16-bit views are rounded to 8 bits. If they use fewer bits, they are first
    scaled up to all 16.

    Raises `ValueError` as `read_light_field` does.
    """
    return convert_views(read_light_field(path, grid=grid, layout=layout).views, keeps_grey=keeps_grey)


def convert_views(
    views: NDArray[np.uint8 | np.uint16], *, keeps_grey: bool, unused: int | None = None
) -> NDArray[np.uint8]:
    """Converts views of 8 or 16 bits, grey or RGB, as described at `read_views`. `unused`: by how many bits those of 16
    are scaled up; None for as many as they don't use.
    """
    if views.dtype == np.uint16:
        views = np.rint(raise_levels(views, count_unused_bits(views) if unused is None else unused) / 257)
    channels = views.shape[4] if keeps_grey else 3
    return np.ascontiguousarray(np.broadcast_to(views, (*views.shape[:4], channels)).astype(np.uint8))


def read_light_field(
    path: Path,
    *,
    grid: tuple[int, int] | None = None,
    layout: Layout | None = None,
    least: int = LEAST,
    takes_one: bool = False,
) -> LightField:
    """Reads the middle `grid` = (V, U) views of a light field, by default all: grey or RGB, without opaque alpha.

    `path`: a folder or a zip of views, or any other light field that `ciir.open` reads. `layout`: how it is arranged in
    its file, if the caller knows. `least`: the smallest side of a view, in pixels. `takes_one`: whether a single view
    is read, too.

    Raises `ValueError` if there is no full grid of views of one size, it is smaller than `grid`, or the views are
    smaller than `least` or see-through.
    """
    if not path.exists():
        raise ValueError(f"{path}: no such folder or file; name a light field, such as a folder of views")
    shown = path.resolve().name
    try:
        field = inputs.read(Bundle.from_path(path), layout or Layout())
    except InputError as error:
        message = str(error).removeprefix(f"{path}: ").removeprefix(f"{shown}: ")
        problem, _, advice = message.partition("; ")
        if layout is None and re.search(OPTION, advice):
            folder = "name all views view_VV_UU.png by row and column, and remove other pictures"
            file = f"give a folder of views, which `ciir convert {shown} -o FOLDER` makes; see ciir convert --help"
            message = f"{problem}; {folder if path.is_dir() else file}"
        raise ValueError(f"{path}: {message}") from error
    if not isinstance(field, LightField) or (field.views.shape[:2] == (1, 1) and not takes_one):
        raise ValueError(f"{path}: not a set of views; name a folder of pictures, one for each view, or a container")
    views = drop_alpha(field, path).views
    down, across = grid or views.shape[:2]
    if down > views.shape[0] or across > views.shape[1]:
        raise ValueError(
            f"{path}: {views.shape[0]}x{views.shape[1]} views; --grid {down}x{across} needs more: give a smaller grid"
        )
    if min(views.shape[2:4]) < least:
        raise ValueError(
            f"{path}: views of {views.shape[2]}x{views.shape[3]} pixels; at least {least}x{least} are needed: "
            "name larger views"
        )
    top, left = (views.shape[0] - down) // 2, (views.shape[1] - across) // 2
    return replace(field, views=views[top : top + down, left : left + across])


def drop_alpha(field: LightField, path: Path) -> LightField:
    """Returns `field`, read from `path`, without its alpha. Raises `ValueError` if that isn't opaque."""
    views = field.views if field.is_transparent() else field.views[..., : 3 if field.views.shape[4] > 2 else 1]
    if views.shape[4] not in (1, 3):
        raise ValueError(f"{path}: views of {views.shape[4]} channels, not all opaque; give grey or RGB")
    return replace(field, views=views)


def degrade_views(views: NDArray[np.uint8], kind: str, scale: int) -> Pair:
    """Degrades each view with `training.data.downscale.downscale_picture`, and raises the same `ValueError`."""
    made = [downscale_picture(kind, view, scale) for view in views.reshape(-1, *views.shape[2:])]
    return Pair(*(np.stack(part).reshape(*views.shape[:2], *part[0].shape) for part in zip(*made, strict=True)))


def compress_array(views: NDArray[np.uint8], quality: int) -> LightField:
    """Returns views `(V, U, H, W, C)`, grey or RGB, as they are upscaled when read from a JPEG of their elemental image
    array with this `quality`, 1 to 100: 8 bits. Reading partly undoes the file's rounding.
    """
    array = LightField(views).eia().astype(np.uint8)
    data = encode_jpeg(array if array.shape[2] == 3 else array[..., 0], quality)
    layout = Layout(pixels=(views.shape[0], views.shape[1]), arrangement="eia", restores_jpeg=True)
    return eia.read(data, name="array", layout=layout, limits=DEFAULT_LIMITS)
