"""Validation of a single-picture network during training: Y-PSNR on a small set that is read once at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from ciir.training.data import pictures
from ciir.training.data.downscale import Pair, downscale_picture
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from torch import Tensor, nn

    from ciir.training.data.pictures import Picture


def read_pairs(folder: Path, scale: int) -> list[Pair]:
    """Reads the pairs in `folder`: `*_LR.png` with their `*_HR.png`, or if there are none all its pictures, with
    bicubic LR.

    Raises `ValueError` if there is none, one can't be read, an HR is missing, or a pair has another scale.
    """
    files = pictures.find_pictures(folder)
    pairs = pictures.pair_files(files)
    unused = pictures.count_unused(file for pair in pairs for file in pair) if pairs else pictures.count_unused(files)
    if not pairs:
        return [_make_pair(path, scale, unused) for path in files]
    read = []
    for path, truth in pairs:
        low, high = pictures.read_rgb(path, unused=unused), pictures.read_rgb(truth, unused=unused)
        if high.shape != (scale * low.shape[0], scale * low.shape[1], 3):
            raise ValueError(
                f"{truth}: {high.shape[0]}x{high.shape[1]} pixels, but its LR is {low.shape[0]}x{low.shape[1]}; "
                f"name a folder of pairs at scale {scale}"
            )
        read.append(Pair(low, high))
    return read


def _make_pair(path: Path, scale: int, unused: int) -> Pair:
    picture = pictures.read_rgb(path, unused=unused)
    if min(picture.shape[:2]) < 3 * scale:  # the protocol cuts a border of `scale`, and something must remain
        raise ValueError(f"{path}: too small to validate on at scale {scale}; remove it from the folder")
    return downscale_picture("bicubic", picture, scale)


@torch.no_grad()
def score_outputs(network: nn.Module, cases: Iterable[tuple[tuple[Tensor, ...], Picture]], border: int) -> float:
    """Computes the mean Y-PSNR in dB of a network's outputs, rounded to 8 bits, against their truths `(H, W, 3)`.

    `border`: the number of pixels that are cut along each edge. The network runs on the device where it is.
    """
    device = next(network.parameters()).device
    network.eval()
    scores = []
    for inputs, high in cases:
        made = network(*(part.to(device) for part in inputs))[0].permute(1, 2, 0)
        picture = made.clamp(0, 1).mul(255).round().byte().cpu().numpy()
        scores.append(compute_psnr(rgb_to_luma(picture), rgb_to_luma(high), border=border))
    network.train()
    return sum(scores) / len(scores)


def validate_network(network: nn.Module, against: list[Pair], scale: int) -> float:
    """Computes the mean Y-PSNR in dB by the published protocol: 8-bit outputs with a border of `scale` cut.

    Grey pictures are scored as RGB, which gives 1.3 dB more than in `training.evaluation.pictures`.
    """
    cases = (((torch.from_numpy(pictures.convert_to_input(low)),), high) for low, high in against)
    return score_outputs(network, cases, scale)
