"""Moves a camera on a path among the views of a light field, and draws what it sees."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ciir.cores import count_available_cores
from ciir.errors import InvalidOption
from ciir.renderer.displays.interpolation import choose_searched, interpolate_view
from ciir.renderer.writers.options import PathName

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels

_TURNS = 3
"""Turns of the spiral."""
_ROUNDING = 1e-9
"""How far rounding may move a position."""


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
    """Yields what the camera sees at each position, `(H, W, 3)`: between views, interpolated ones
    (`renderer.displays.interpolation`), first along rows, then between these.

    `unused`: from `ciir.bit_depth.count_unused_camera_bits`.
    """
    views = light_field.with_depth_sense("cameras").views
    rows, columns = views.shape[:2]
    across = choose_searched(views[(rows - 1) // 2])
    down = choose_searched(_turn(views[:, (columns - 1) // 2]))

    def draw(position: tuple[float, float]) -> NDArray[np.uint8]:
        v, u = position
        some = slice(math.floor(v + _ROUNDING), math.ceil(v - _ROUNDING) + 1)
        beside: NDArray[Any] = np.stack([interpolate_view(row, u, across) for row in views[some]])
        seen = interpolate_view(_turn(beside), v - some.start, down)
        return to_rgb8(seen.transpose(1, 0, 2), unused)

    count = count_available_cores()
    positions = list_positions(path, frames, (rows, columns))
    with ThreadPoolExecutor(count, thread_name_prefix="frames") as pool:
        for first in range(0, frames, count):  # so that few frames are kept
            yield from pool.map(draw, positions[first : first + count])


def _turn(views: NDArray[Any]) -> NDArray[Any]:
    """Returns views of a column `(n, H, W, C)` as those of a row `(n, W, H, C)`."""
    return views.transpose(0, 2, 1, 3)


def to_rgb8(pixels: Pixels, unused: int = 0) -> NDArray[np.uint8]:
    """Returns a picture as a frame, `(H, W, 3)`: grey becomes RGB, alpha is ignored, 16 bits are raised by `unused`
    bits and rounded.
    """
    colours = pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1].repeat(3, axis=2)
    share = colours.astype(np.float32) * 2**unused / np.float32(np.iinfo(pixels.dtype).max)
    levels: NDArray[np.uint8] = np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)
    return levels
