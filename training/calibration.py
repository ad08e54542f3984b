"""What an int8 network is calibrated on: real views, each with the picture that it ought to become."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from renderer.scenes import SCENES, scene
from training import degrade, mesh_views, pictures

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from training.pictures import Picture

    Pair = tuple[Picture, Picture]
    """LR `(h, w, 3)` and its truth `(scale*h, scale*w, 3)`, 8 bit."""

PICTURES = 36
"""Most pictures that are taken of each folder, evenly over their names."""
SIDE = 128
"""Longest side of an LR view of a picture: its middle."""
VIEWS = 3
"""Turned views of each built-in scene, one for each size of array in `mesh_views.LENSES`."""


def pairs(folders: Sequence[Path], scale: int) -> list[Pair]:
    """Of each folder's pictures, degraded in turn by each of `degrade.KINDS`, and of the built-in scenes' views.

    Raises `ValueError` where a folder has no picture, or one can't be read or is smaller than one LR pixel.
    """
    found: list[Pair] = []
    for folder in folders:
        files = [file for file in pictures.find(folder) if not file.name.endswith("_LR.png")]
        chosen = files[:: max(1, len(files) // PICTURES)][:PICTURES]
        for index, file in enumerate(chosen):
            photograph = torch.from_numpy(pictures.read_rgb(file)).permute(2, 0, 1)
            kind = degrade.KINDS[index % len(degrade.KINDS)]
            try:
                low, high = degrade.pair(kind, _middle(photograph, SIDE * degrade.cell(kind, scale)), scale)
            except ValueError as error:
                raise ValueError(f"{file}: {error}; take it out of the folder") from error
            found.append((low.permute(1, 2, 0).numpy(), high.permute(1, 2, 0).numpy()))
    for name in SCENES:
        for index in range(VIEWS):
            found.extend(mesh_views.pairs(scene(name), seed=0, index=index, scale=scale))
    return found


def as_input(low: Picture) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """`(h, w, 3)` 8 bit as a network takes it: `(1, 3, h, w)` float32 in [0, 1]."""
    return np.ascontiguousarray(low.transpose(2, 0, 1)[np.newaxis].astype(np.float32) / 255)


def _middle(photograph: torch.Tensor, side: int) -> torch.Tensor:
    height, width = photograph.shape[-2:]
    top, left = max(0, height - side) // 2, max(0, width - side) // 2
    return photograph[:, top : top + side, left : left + side]
