"""Any folder of pictures, as crops for training."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from tqdm import tqdm

from training import degrade

if TYPE_CHECKING:
    from collections.abc import Mapping
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
PHOTOGRAPHS = ("bicubic", "box", "point")
"""Degradations of photographs: see `training.degrade`."""
RENDERED = ("pinhole", "lenslet")
"""What kinds of array see of random scenes: see `training.rendered`."""


def _degraded(kind: str, photograph: Tensor, scale: int) -> Pair:
    """A photograph `(3, H, W)`, 8 bit, as a pair. For `point` the HR picture is the photograph at half its size."""
    high = degrade.crop_to_multiple(photograph[None].float().div(255.0), 2 * scale if kind == "point" else scale)
    if kind == "point":
        # A point must be smaller than a pixel of the truth: the middle of a cell of the photograph at twice the scale.
        low, high = degrade.point(high, 2 * scale), degrade.box(high, 2)
    else:
        low = {"bicubic": degrade.bicubic, "box": degrade.box}[kind](high, scale)
    return tuple(t[0].mul(255.0).round().to(torch.uint8) for t in (low, high))  # type: ignore[return-value]


def _rendered(photographs: list[Tensor], scenes: int, *, scale: int, crop: int, seed: int) -> dict[str, list[Pair]]:
    """Pairs of a pinhole array's views, and of a lenslet array's, with the photographs as textures."""
    from training import rendered

    if scale != 2 or crop > 2 * rendered.SIDE:
        raise ValueError(f"scenes are rendered for scale 2 and crops up to {2 * rendered.SIDE}, not {scale} and {crop}")
    textures = [photograph.permute(1, 2, 0).numpy() for photograph in photographs]
    pairs: dict[str, list[Pair]] = {kind: [] for kind in RENDERED}
    for index in tqdm(range(scenes), disable=None, desc="rendering", unit="scene"):
        for kind, (low, high) in zip(RENDERED, rendered.pairs(textures, seed=seed, index=index), strict=True):
            pairs[kind].append((torch.from_numpy(low).permute(2, 0, 1), torch.from_numpy(high).permute(2, 0, 1)))
    return pairs


class Crops:
    """Random aligned LR/HR crops with flips and rotations, kept in memory as 8 bits.

    The batch of step `s` depends only on the seed and `s`, so that a resumed run sees what an unbroken one would.
    LR pictures are made once from whole pictures, as the published protocol does, and cropped on the sample grid.
    """

    def __init__(
        self,
        folder: Path,
        *,
        crop: int,
        scale: int,
        batch: int,
        seed: int,
        degradations: Mapping[str, float] = MappingProxyType({"bicubic": 1.0}),
        scenes: int = 0,
    ) -> None:
        """`crop`: HR side in pixels, a multiple of `scale`. `degradations`: kind -> weight, of `PHOTOGRAPHS` and, with
        `scenes` random scenes at scale 2, of `RENDERED`.
        """
        if crop % scale:
            raise ValueError(f"a crop of {crop} pixels is not a multiple of the scale {scale}")
        self.crop, self.scale, self.batch, self.seed = crop, scale, batch, seed
        photographs = [read_picture(path).permute(2, 0, 1) for path in picture_files(folder)]
        pairs = {
            kind: [_degraded(kind, photograph, scale) for photograph in photographs]
            for kind in PHOTOGRAPHS
            if kind in degradations
        }
        if scenes:
            pairs |= _rendered(photographs, scenes, scale=scale, crop=crop, seed=seed)
        self.groups: list[list[Pair]] = []
        for kind in degradations:
            if kind not in pairs:
                raise ValueError(f"degradations: no {kind!r} here; {', '.join(RENDERED)} need scenes")
            large = [pair for pair in pairs[kind] if min(pair[1].shape[-2:]) >= crop]
            if not large:
                raise ValueError(f"{folder}: every picture is smaller than the crop of {crop}x{crop} pixels ({kind})")
            self.groups.append(large)
        weights = np.array(list(degradations.values()), float)
        self.shares = weights / weights.sum()

    def at(self, step: int) -> tuple[Tensor, Tensor]:
        """LR `(batch, 3, crop/scale, crop/scale)` and HR `(batch, 3, crop, crop)`, float in [0, 1]."""
        random = np.random.default_rng((self.seed, step))
        side = self.crop // self.scale
        lows: list[Tensor] = []
        highs: list[Tensor] = []
        for _ in range(self.batch):
            group = self.groups[int(random.choice(len(self.groups), p=self.shares))]
            low, high = group[random.integers(len(group))]
            y = int(random.integers(low.shape[1] - side + 1))
            x = int(random.integers(low.shape[2] - side + 1))
            turns, mirror = int(random.integers(4)), bool(random.integers(2))
            for source, into, s in ((low, lows, 1), (high, highs, self.scale)):
                part = source[:, y * s : (y + side) * s, x * s : (x + side) * s]
                part = torch.rot90(part, turns, (1, 2))
                into.append(part.flip(2) if mirror else part)
        return torch.stack(lows).float().div(255.0), torch.stack(highs).float().div(255.0)
