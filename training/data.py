"""Any folder of pictures, as crops for training."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from training import degrade

if TYPE_CHECKING:
    from pathlib import Path

SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}


def picture_files(folder: Path) -> list[Path]:
    """The pictures in `folder`, sorted by name; `ValueError` where there is none."""
    files = sorted(path for path in folder.glob("*") if path.suffix.lower() in SUFFIXES)
    if not files:
        raise ValueError(f"{folder}: no picture in it ({', '.join(sorted(SUFFIXES))}); name a folder that holds some")
    return files


def read_picture(path: Path) -> Tensor:
    """8-bit RGB, `(H, W, 3)` uint8."""
    with Image.open(path, formats=("PNG", "JPEG", "TIFF", "BMP")) as image:
        return torch.from_numpy(np.array(image.convert("RGB")))


class Crops:
    """Random aligned LR/HR crops with flips and rotations, kept in memory as 8 bits.

    The batch of step `s` depends only on the seed and `s`, so that a resumed run sees what an unbroken one would.
    LR pictures are made once from whole pictures, as the published protocol does, and cropped on the sample grid.
    """

    def __init__(self, folder: Path, *, crop: int, scale: int, batch: int, seed: int) -> None:
        """`crop`: HR side in pixels, a multiple of `scale`."""
        if crop % scale:
            raise ValueError(f"a crop of {crop} pixels is not a multiple of the scale {scale}")
        self.crop, self.scale, self.batch, self.seed = crop, scale, batch, seed
        self.pairs: list[tuple[Tensor, Tensor]] = []  # (3, h, w), (3, H, W) uint8
        for path in picture_files(folder):
            high = degrade.crop_to_multiple(degrade.to_tensor(read_picture(path)), scale)
            if min(high.shape[-2:]) < crop:
                continue
            low = degrade.bicubic(high, scale)
            self.pairs.append(tuple(t[0].mul(255.0).round().to(torch.uint8) for t in (low, high)))  # type: ignore[arg-type]
        if not self.pairs:
            raise ValueError(f"{folder}: every picture is smaller than the crop of {crop}x{crop} pixels")

    def at(self, step: int) -> tuple[Tensor, Tensor]:
        """LR `(batch, 3, crop/scale, crop/scale)` and HR `(batch, 3, crop, crop)`, float in [0, 1]."""
        random = np.random.default_rng((self.seed, step))
        side = self.crop // self.scale
        lows: list[Tensor] = []
        highs: list[Tensor] = []
        for _ in range(self.batch):
            low, high = self.pairs[random.integers(len(self.pairs))]
            y = int(random.integers(low.shape[1] - side + 1))
            x = int(random.integers(low.shape[2] - side + 1))
            turns, mirror = int(random.integers(4)), bool(random.integers(2))
            for source, into, s in ((low, lows, 1), (high, highs, self.scale)):
                part = source[:, y * s : (y + side) * s, x * s : (x + side) * s]
                part = torch.rot90(part, turns, (1, 2))
                into.append(part.flip(2) if mirror else part)
        return torch.stack(lows).float().div(255.0), torch.stack(highs).float().div(255.0)
