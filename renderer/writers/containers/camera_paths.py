"""Moves a camera on a path among the views of a light field, and draws what it sees."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers.options import PathName

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField

_TURNS = 3
"""Turns of the spiral."""


def list_positions(path: PathName, frames: int, grid: tuple[int, int]) -> list[tuple[float, float]]:
    """Returns `frames` positions (v, u) on a closed path: the one after the last is the first again.

    `circle`: an ellipse that touches the sides of the grid, from the right, upwards first; `sweep`: along the middle
    row from the left to the right and back, slower at the ends; `spiral`: from the centre outwards and back.

    Raises `InvalidOption` for another path.
    """
    if path not in get_args(PathName):
        raise InvalidOption(f"path: {path!r} is not known; give {', '.join(get_args(PathName))}")
    radius_v, radius_u = ((count - 1) / 2 for count in grid)
    positions = []
    for frame in range(frames):
        time = frame / frames
        swing = -math.cos(2 * math.pi * time)
        if path == "sweep":
            v, u = 0.0, swing
        else:
            turns, radius = (_TURNS, (1 + swing) / 2) if path == "spiral" else (1, 1.0)
            angle = 2 * math.pi * turns * time
            v, u = -radius * math.sin(angle), radius * math.cos(angle)
        positions.append((radius_v * (1 + v), radius_u * (1 + u)))
    return positions


def draw_frames(light_field: LightField, path: PathName, frames: int, unused: int = 0) -> Iterator[NDArray[np.uint8]]:
    """Yields what the camera sees at each position, `(H, W, 3)`: between views, the nearest four, blended
    bilinearly.

    `unused`: from `ciir.bit_depth.count_unused_camera_bits`.
    """
    views = light_field.with_depth_sense("cameras").views
    positions = list_positions(path, frames, (views.shape[0], views.shape[1]))
    return (_to_rgb8(_blend(views, v, u) * 2**unused) for v, u in positions)


def _blend(views: NDArray[Any], v: float, u: float) -> NDArray[np.float32]:
    """Returns the mean of the views around (v, u), each weighted by 1 minus its distance in v and in u."""
    top, left = math.floor(v), math.floor(u)
    blended = np.zeros(views.shape[2:], np.float32)
    for row, weight_v in ((top, 1 - (v - top)), (top + 1, v - top)):
        for column, weight_u in ((left, 1 - (u - left)), (left + 1, u - left)):
            if weight_v * weight_u > 0:
                blended += np.float32(weight_v * weight_u) * views[row, column]
    return blended / np.float32(np.iinfo(views.dtype).max)


def to_rgb8(pixels: NDArray[np.uint8] | NDArray[np.uint16], unused: int = 0) -> NDArray[np.uint8]:
    """Returns a picture as a frame, `(H, W, 3)`: grey becomes RGB, alpha is ignored, 16 bits are raised by `unused`
    bits and rounded.
    """
    return _to_rgb8(pixels.astype(np.float32) * 2**unused / np.float32(np.iinfo(pixels.dtype).max))


def _to_rgb8(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Converts to RGB: grey is repeated, alpha is ignored."""
    colours = picture[..., :3] if picture.shape[2] >= 3 else picture[..., :1].repeat(3, axis=2)
    return np.rint(255 * np.clip(colours, 0, 1)).astype(np.uint8)
