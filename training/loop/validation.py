"""Validation of a single-picture network during training: Y-PSNR on a small set that is read once, at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from ciir.training.data import pictures
from ciir.training.data.downscale import Pair, downscale_picture
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor, nn

    from ciir.training.data.pictures import Picture


def read_pairs(folder: Path, scale: int) -> list[Pair]:
    """The pairs in `folder`: `*_LR.png` with their `*_HR.png`, or of all its pictures, with bicubic LR.

    Raises `ValueError` where there is none, one can't be read, an HR is missing, or a pair is at another scale.
    """
    files = pictures.find_pictures(folder)
    lows = [path for path in files if path.name.endswith("_LR.png")]
    if not lows:
        return [_make_pair(path, scale) for path in files]
    read = []
    for path in lows:
        truth = path.with_name(path.name.replace("_LR.png", "_HR.png"))
        if not truth.is_file():
            raise ValueError(f"{truth}: missing; each *_LR.png needs its *_HR.png")
        low, high = pictures.read_rgb(path), pictures.read_rgb(truth)
        if high.shape != (scale * low.shape[0], scale * low.shape[1], 3):
            raise ValueError(
                f"{truth}: {high.shape[0]}x{high.shape[1]} pixels, where its LR is {low.shape[0]}x{low.shape[1]}; "
                f"name a folder of pairs at scale {scale}"
            )
        read.append(Pair(low, high))
    return read


def _make_pair(path: Path, scale: int) -> Pair:
    picture = pictures.read_rgb(path)
    if min(picture.shape[:2]) < 3 * scale:  # the protocol cuts a border of `scale`, and something must remain
        raise ValueError(f"{path}: too small to validate on at scale {scale}; remove it from the folder")
    return downscale_picture("bicubic", picture, scale)


def _to_pixels(image: Tensor) -> Picture:
    """`(1, 3, H, W)` float, nominally in [0, 1] -> `(H, W, 3)` 8 bit."""
    pixels: Picture = image[0].permute(1, 2, 0).clamp(0, 1).mul(255).round().byte().cpu().numpy()
    return pixels


@torch.no_grad()
def validate_network(network: nn.Module, against: list[Pair], scale: int) -> float:
    """Mean Y-PSNR in dB by the published protocol: 8-bit outputs, a border of `scale` cut. Runs where the network is.

    Grey pictures count as RGB ones, 1.3 dB higher than `training.evaluation.pictures` has them.
    """
    device = next(network.parameters()).device
    network.eval()
    scores = []
    for low, high in against:
        image = torch.from_numpy(low).permute(2, 0, 1)[None].float().div(255)
        picture = _to_pixels(network(image.to(device)))
        scores.append(compute_psnr(rgb_to_luma(picture), rgb_to_luma(high), border=scale))
    network.train()
    return sum(scores) / len(scores)
