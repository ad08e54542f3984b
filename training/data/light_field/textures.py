"""Pictures in one block of memory on a device, from which many textures are cut at once."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

if TYPE_CHECKING:
    from ciir.training.data.pictures import Picture, Pictures

TEXTURE = 160
"""Pixels along each side of a texture."""


class Textures:
    """The pictures that are large enough for a texture, 8 bit. All of them stay in the device's memory."""

    def __init__(self, pictures: Pictures, device: torch.device) -> None:
        """Raises `ValueError` if no picture is large enough."""
        self.pictures = _Large(pictures)
        """The whole pictures."""
        self._sizes = np.array(self.pictures.sizes, np.int64)
        ends = np.cumsum(self._sizes.prod(axis=1))
        self._starts = ends - self._sizes.prod(axis=1)
        self._pixels = torch.empty((int(ends[-1]), 3), dtype=torch.uint8, device=device)
        for number, (start, end) in enumerate(zip(self._starts.tolist(), ends.tolist(), strict=True)):
            self._pixels[start:end] = torch.from_numpy(self.pictures[number].copy()).reshape(-1, 3).to(device)
        side = torch.arange(TEXTURE, device=device)
        self._down, self._across = side[:, None], side[None]

    def cut(self, random: np.random.Generator, count: int) -> Tensor:
        """Cuts `count` parts of random pictures, `(count, 3, TEXTURE, TEXTURE)` in [0, 1], on the device."""
        chosen = random.integers(0, len(self.pictures), count)
        top, left = ((random.random(count) * (sizes - TEXTURE + 1)).astype(np.int64) for sizes in self._sizes[chosen].T)
        width = self._sizes[chosen, 1]
        first = torch.from_numpy(self._starts[chosen] + top * width + left).to(self._pixels.device)
        stride = torch.from_numpy(width).to(self._pixels.device)
        places = first[:, None, None] + stride[:, None, None] * self._down + self._across
        return self._pixels[places].permute(0, 3, 1, 2).float().div(255)


class _Large:
    """The pictures that are large enough."""

    def __init__(self, pictures: Pictures) -> None:
        self._pictures = pictures
        self._large = [number for number, size in enumerate(pictures.sizes) if min(size) >= TEXTURE]
        if not self._large:
            raise ValueError(f"train: no picture is as large as {TEXTURE}x{TEXTURE}; name others")
        if len(self._large) < len(pictures):
            left_out = f"{len(pictures) - len(self._large)} of {len(pictures)} pictures are skipped"
            tqdm.write(f"train: {left_out}: they are smaller than {TEXTURE}x{TEXTURE} pixels", file=sys.stderr)
        self.sizes = [pictures.sizes[number] for number in self._large]
        """Height and width of each."""

    def __len__(self) -> int:
        return len(self._large)

    def __getitem__(self, index: int) -> Picture:
        return self._pictures[self._large[index]]
