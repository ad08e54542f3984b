"""Low-resolution versions of finely sampled views, many at once, as `training.data.downscale` makes them for a picture.

All tensors are 8 bit, `(N, C, H, W)`, on any device.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ciir.training.data.light_field.layered_scenes import FINE


def degrade(kind: str, fine: Tensor) -> tuple[Tensor, Tensor]:
    """Makes LR and HR of pictures that were sampled `FINE` times as finely as LR along each side. `kind`: one of
    `training.data.downscale.KINDS`."""
    if kind == "point":  # the mean of the four samples around the middle of each cell
        middle = slice(FINE // 2 - 1, FINE // 2 + 1)
        return _round_mean(_split_cells(fine, FINE)[:, :, :, middle, :, middle]), _average_cells(fine, 2)
    high = _average_cells(fine, FINE // 2)
    return (_average_cells(high, 2) if kind == "box" else _downscale_bicubic(high)), high


def _average_cells(picture: Tensor, side: int) -> Tensor:
    return _round_mean(_split_cells(picture, side))


def _split_cells(picture: Tensor, side: int) -> Tensor:
    """Splits `(N, C, H, W)` into cells: `(N, C, H / side, side, W / side, side)`."""
    count, channels, height, width = picture.shape
    return picture.reshape(count, channels, height // side, side, width // side, side)


def _round_mean(cells: Tensor) -> Tensor:
    return cells.float().mean((3, 5)).round().byte()


def _downscale_bicubic(picture: Tensor) -> Tensor:
    down, across = (_bicubic(length).to(picture.device) for length in picture.shape[2:])
    levels = down @ picture.float() @ across.T
    return (levels + 0.5).floor().clamp(0, 255).byte()


@lru_cache(maxsize=16)
def _bicubic(length: int) -> Tensor:
    """Returns the weights of Pillow's bicubic filter that reduce `length` samples to half the resolution,
    `(length / 2, length)`."""
    each = Image.fromarray(np.eye(length, dtype=np.float32))
    return torch.from_numpy(np.array(each.resize((length, length // 2), Image.Resampling.BICUBIC)))
