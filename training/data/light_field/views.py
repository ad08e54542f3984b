"""Light fields for validation and evaluation: folders of views and their low-resolution versions."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.errors import InputError
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.training.data.downscale import downscale_picture

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

LEAST = 16
"""Smallest side of a view in pixels: its low-resolution version must be large enough to be scored."""


class Pair(NamedTuple):
    """A low-resolution light field `(V, U, h, w, 3)` and its truth `(V, U, scale*h, scale*w, 3)`, 8-bit RGB."""

    low: NDArray[np.uint8]
    high: NDArray[np.uint8]


def read_views(folder: Path, *, grid: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """Reads the views in `folder`, `(V, U, H, W, 3)` 8-bit RGB; only the middle ones where `grid` = (V, U) is smaller.

    Raises `ValueError` where there is no full grid of pictures of one size, it is smaller than `grid`, or the views are
    smaller than `LEAST`.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; name a folder of pictures, one for each view")
    bundle = Bundle.from_path(folder)
    try:
        field = inputs.read(bundle)
    except InputError as error:
        message = str(error).removeprefix(f"{bundle.name}: ")
        problem, _, remedy = message.rpartition("; ")
        if remedy.startswith("give pixels "):  # this option exists for reconstruction only
            message = (
                f"{problem}; name them view_VV_UU.png by row and column, or remove the pictures that are not views"
            )
        raise ValueError(f"{folder}: {message}") from error
    if not isinstance(field, LightField) or field.views.shape[:2] == (1, 1):
        raise ValueError(f"{folder}: no set of views; name a folder of pictures, one for each view")
    views = field.views if field.is_transparent() else field.views[..., : 3 if field.views.shape[4] > 2 else 1]
    if views.dtype != np.uint8 or views.shape[4] not in (1, 3):
        raise ValueError(f"{folder}: views of {views.shape[4]} channels, {views.dtype}; give 8-bit grey or RGB")
    down, across = grid or views.shape[:2]
    if down > views.shape[0] or across > views.shape[1]:
        raise ValueError(
            f"{folder}: {views.shape[0]}x{views.shape[1]} views; --grid {down}x{across} needs more: give a smaller grid"
        )
    if min(views.shape[2:4]) < LEAST:
        raise ValueError(
            f"{folder}: views of {views.shape[2]}x{views.shape[3]} pixels; at least {LEAST}x{LEAST} are needed: "
            "name larger views"
        )
    top, left = (views.shape[0] - down) // 2, (views.shape[1] - across) // 2
    views = views[top : top + down, left : left + across]
    return np.ascontiguousarray(np.broadcast_to(views, (*views.shape[:4], 3)).astype(np.uint8))


def degrade_views(views: NDArray[np.uint8], kind: str, scale: int) -> Pair:
    """Degrades each view as `training.data.downscale.downscale_picture`. Raises `ValueError` as that does."""
    made = [downscale_picture(kind, view, scale) for view in views.reshape(-1, *views.shape[2:])]
    return Pair(*(np.stack(part).reshape(*views.shape[:2], *part[0].shape) for part in zip(*made, strict=True)))
