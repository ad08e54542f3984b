"""Any folder of pictures, as crops for training."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from tqdm import tqdm

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
    """8-bit RGB, `(H, W, 3)` uint8. Raises `ValueError` where the picture can't be read."""
    try:
        with Image.open(path, formats=("PNG", "JPEG", "TIFF", "BMP")) as image:
            return torch.from_numpy(np.array(image.convert("RGB")))
    except (OSError, SyntaxError) as error:
        raise ValueError(f"{path}: not a picture that can be read; mend it or take it out of the folder") from error


Pair = tuple[Tensor, Tensor]
"""LR `(3, h, w)` and HR `(3, H, W)`, 8 bit."""
SHARES = (0.5, 0.35, 0.15)
"""Of crops of photographs, of a pinhole array's views and of a lenslet array's, where scenes are rendered."""


def _rendered(
    photographs: list[Pair], scenes: int, *, scale: int, crop: int, seed: int
) -> tuple[list[Pair], list[Pair]]:
    """Pairs of a pinhole array's views, and of a lenslet array's, with the photographs as textures."""
    from training import rendered

    if scale != 2 or crop > 2 * rendered.SIDE:
        raise ValueError(f"scenes are rendered for scale 2 and crops up to {2 * rendered.SIDE}, not {scale} and {crop}")
    textures = [high.permute(1, 2, 0).numpy() for _, high in photographs]
    pinhole: list[Pair] = []
    lenslet: list[Pair] = []
    for index in tqdm(range(scenes), disable=None, desc="rendering", unit="scene"):
        for into, (low, high) in zip((pinhole, lenslet), rendered.pairs(textures, seed=seed, index=index), strict=True):
            into.append((torch.from_numpy(low).permute(2, 0, 1), torch.from_numpy(high).permute(2, 0, 1)))
    return pinhole, lenslet


class Crops:
    """Random aligned LR/HR crops with flips and rotations, kept in memory as 8 bits.

    The batch of step `s` depends only on the seed and `s`, so that a resumed run sees what an unbroken one would.
    LR pictures are made once from whole pictures, as the published protocol does, and cropped on the sample grid.
    """

    def __init__(self, folder: Path, *, crop: int, scale: int, batch: int, seed: int, scenes: int = 0) -> None:
        """`crop`: HR side in pixels, a multiple of `scale`. `scenes`: rendered ones beside the pictures; scale 2 only.

        With scenes, half of the crops are of photographs and half of views: see `SHARES`.
        """
        if crop % scale:
            raise ValueError(f"a crop of {crop} pixels is not a multiple of the scale {scale}")
        self.crop, self.scale, self.batch, self.seed = crop, scale, batch, seed
        photographs: list[Pair] = []
        for path in picture_files(folder):
            high = degrade.crop_to_multiple(degrade.to_tensor(read_picture(path)), scale)
            if min(high.shape[-2:]) < crop:
                continue
            low = degrade.bicubic(high, scale)
            photographs.append(tuple(t[0].mul(255.0).round().to(torch.uint8) for t in (low, high)))  # type: ignore[arg-type]
        if not photographs:
            raise ValueError(f"{folder}: every picture is smaller than the crop of {crop}x{crop} pixels")
        self.groups = [photographs]
        if scenes:
            self.groups += _rendered(photographs, scenes, scale=scale, crop=crop, seed=seed)

    def at(self, step: int) -> tuple[Tensor, Tensor]:
        """LR `(batch, 3, crop/scale, crop/scale)` and HR `(batch, 3, crop, crop)`, float in [0, 1]."""
        random = np.random.default_rng((self.seed, step))
        side = self.crop // self.scale
        lows: list[Tensor] = []
        highs: list[Tensor] = []
        for _ in range(self.batch):
            group = self.groups[random.choice(3, p=SHARES) if len(self.groups) > 1 else 0]
            low, high = group[random.integers(len(group))]
            y = int(random.integers(low.shape[1] - side + 1))
            x = int(random.integers(low.shape[2] - side + 1))
            turns, mirror = int(random.integers(4)), bool(random.integers(2))
            for source, into, s in ((low, lows, 1), (high, highs, self.scale)):
                part = source[:, y * s : (y + side) * s, x * s : (x + side) * s]
                part = torch.rot90(part, turns, (1, 2))
                into.append(part.flip(2) if mirror else part)
        return torch.stack(lows).float().div(255.0), torch.stack(highs).float().div(255.0)
