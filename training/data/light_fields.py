"""Light fields for validation and evaluation: a folder of views, made small as `training.data.degrade` does."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from ciir.errors import InputError
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.training.data import degrade

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

LEAST = 16
"""Least pixels along each side of a view: so many are left of it, made small, that it can be compared."""


class Pair(NamedTuple):
    """A light field made small, and its truth: `(V, U, h, w, 3)` and `(V, U, scale*h, scale*w, 3)`, 8-bit RGB."""

    low: NDArray[np.uint8]
    high: NDArray[np.uint8]


def read_views(folder: Path, *, grid: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """The views in `folder`, `(V, U, H, W, 3)` 8-bit RGB; the middle ones where `grid` = (V, U) asks for fewer.

    Raises `ValueError` where there is no full grid of pictures of one size, or it is smaller than `grid`, or they are
    smaller than `LEAST`.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; name a folder of pictures, one for each view")
    bundle = Bundle.from_path(folder)
    try:
        field = inputs.read(bundle, lenses=None, pixels=None)
    except InputError as error:
        said = str(error).removeprefix(f"{bundle.name}: ")
        problem, _, remedy = said.rpartition("; ")
        if remedy.startswith("give pixels "):  # an option that is there for reconstruction alone
            said = f"{problem}; name them view_VV_UU.png by row and column, or take out those that are no views"
        raise ValueError(f"{folder}: {said}") from error
    if not isinstance(field, LightField) or field.views.shape[:2] == (1, 1):
        raise ValueError(f"{folder}: no set of views; name a folder of pictures, one for each view")
    views = field.views if field.is_transparent() else field.views[..., : 3 if field.views.shape[4] > 2 else 1]
    if views.dtype != np.uint8 or views.shape[4] not in (1, 3):
        raise ValueError(f"{folder}: views of {views.shape[4]} channels, {views.dtype}; give 8-bit grey or RGB")
    down, across = grid or views.shape[:2]
    if down > views.shape[0] or across > views.shape[1]:
        raise ValueError(
            f"{folder}: {views.shape[0]}x{views.shape[1]} views; --grid {down}x{across} asks for more: give fewer"
        )
    if min(views.shape[2:4]) < LEAST:
        raise ValueError(
            f"{folder}: views of {views.shape[2]}x{views.shape[3]} pixels; at least {LEAST}x{LEAST} are of use: "
            "name larger views"
        )
    top, left = (views.shape[0] - down) // 2, (views.shape[1] - across) // 2
    views = views[top : top + down, left : left + across]
    return np.ascontiguousarray(np.broadcast_to(views, (*views.shape[:4], 3)).astype(np.uint8))


def degrade_views(views: NDArray[np.uint8], kind: str, scale: int) -> Pair:
    """Each view made small by `training.data.degrade.make_pair`. Raises `ValueError` as that does."""
    flat = [torch.from_numpy(view).permute(2, 0, 1) for view in views.reshape(-1, *views.shape[2:])]
    made = [degrade.make_pair(kind, view, scale) for view in flat]
    low, high = (
        np.stack([part[side].permute(1, 2, 0).numpy() for part in made]).reshape(*views.shape[:2], *size, 3)
        for side, size in ((0, made[0][0].shape[1:]), (1, made[0][1].shape[1:]))
    )
    return Pair(low, high)
