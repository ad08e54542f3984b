"""Converts views' pixels to and from the planes of float32 in [0, 1] that light-field networks work on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.models.light_field.disparities.shifts import convert_to_float

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels

BLEND_ROWS = 16
"""Rows of a view that are blended at once, so that they stay in the processor's cache."""


def convert_to_planes(picture: Pixels) -> NDArray[np.float32]:
    """Converts `(H, W, 1 or 3)` to `(3, H, W)` in [0, 1]."""
    return np.broadcast_to(convert_to_float(picture), (*picture.shape[:2], 3)).transpose(2, 0, 1)


def round_levels(planes: NDArray[np.float32], like: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Rounds `(3, h, w)` in [0, 1] to the nearest 16-bit levels, `(C, h, w)` with the channels of `like`."""
    grey = planes.mean(axis=0, keepdims=True) if like.shape[-1] == 1 else planes
    levels = grey * np.float32(np.iinfo(like.dtype).max)
    levels += np.float32(0.5)
    return levels.astype(like.dtype)


def write_planes(target: NDArray[Any], planes: NDArray[Any], mask: NDArray[np.bool_] | None) -> None:
    """Sets `target` `(k*h, k*w, C)` to `planes` `(C, k*h, k*w)` where `mask` `(h, w)` is true, or everywhere."""
    if mask is not None:
        scale = len(target) // len(mask)
        mask = mask.repeat(scale, axis=0).repeat(scale, axis=1)
    for channel, plane in enumerate(planes):  # several times faster than all at once
        if mask is None:
            target[..., channel] = plane
        else:
            np.copyto(target[..., channel], plane, where=mask)


def blend_pictures(picture: NDArray[np.uint16], fallback: NDArray[np.uint16], weight: NDArray[np.float32]) -> None:
    """Blends `fallback` into `picture` in place, with its `weight` `(H, W)`. Both are `(scale*H, scale*W, C)`."""
    scale = len(picture) // len(weight)
    for first in range(0, len(weight), BLEND_ROWS):
        part = slice(first * scale, (first + BLEND_ROWS) * scale)
        # Repeated for the channels, because NumPy is several times slower when it broadcasts an axis of three.
        share = weight[first : first + BLEND_ROWS].repeat(scale * picture.shape[2], axis=1).repeat(scale, axis=0)
        mixed = (1 - share) * picture[part].reshape(share.shape)
        mixed += share * fallback[part].reshape(share.shape)
        mixed += np.float32(0.5)
        picture[part] = mixed.reshape(picture[part].shape)
