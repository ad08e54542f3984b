"""Simulates baseline JPEG of grey pictures, many at once on any device. Only the lossy steps are computed."""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn import functional

BLOCK = 8
LUMINANCE = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
"""The quantisation table of quality 50 (ITU-T T.81, table K.1)."""


def compress(levels: Tensor, quality: Tensor) -> Tensor:
    """Returns levels `(N, H, W)`, whole numbers from 0 to 255 as float, after a JPEG of `quality` `(N,)`, 1 to 100 on
    libjpeg's scale."""
    height, width = levels.shape[1:]
    padded = functional.pad(levels[:, None], (0, -width % BLOCK, 0, -height % BLOCK), mode="replicate")[:, 0]
    down, across = (length // BLOCK for length in padded.shape[1:])
    blocks = padded.reshape(-1, down, BLOCK, across, BLOCK).transpose(2, 3) - 128
    basis = _dct().to(levels)
    steps = _quantisation(quality).to(levels)[:, None, None]
    rounded = torch.round(basis @ blocks @ basis.T / steps) * steps
    back = torch.round(basis.T @ rounded @ basis + 128).clamp(0, 255)
    return back.transpose(2, 3).flatten(3, 4).flatten(1, 2)[:, :height, :width]


@lru_cache(maxsize=1)
def _dct() -> Tensor:
    """Returns the orthonormal cosine transform, `(BLOCK, BLOCK)`."""
    number = torch.arange(BLOCK)
    basis = torch.cos(math.pi / BLOCK * (number + 0.5) * number[:, None]) * math.sqrt(2 / BLOCK)
    basis[0] /= math.sqrt(2)
    return basis


def _quantisation(quality: Tensor) -> Tensor:
    """Computes the quantisation tables, `(N, BLOCK, BLOCK)`."""
    scale = torch.where(quality < 50, (5000 / quality).floor(), 200 - 2 * quality)[:, None, None]
    return ((torch.tensor(LUMINANCE, device=quality.device) * scale + 50) / 100).floor().clamp(1, 255)
