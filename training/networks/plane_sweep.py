"""A plane sweep that keeps sub-pixel detail: combines neighbouring views into a fine picture for each disparity.

For each hypothesis of a disparity the samples of all views lie at known places of the view to be upscaled (space sweep:
Collins, CVPR 1996). `view_filters` combines them into a picture twice as fine; where the hypothesis is right, samples
that lie close together agree, and the sweep also returns by how much they don't.

Columns and rows are filtered one after the other. Filters depend on which rows and columns of views the grid has.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.view_filters import make_filters

SIDE = 5
"""Views along each side of the window."""
PLANES = (0.12, 0.25, 0.4, 0.6, 0.85, 1.15, 1.55, 2.0)
"""Disparities of the planes, LR pixels from one view to the next, beside zero and the same below it: they are dense
around zero, as most captured views are close together."""
REACH = 5
"""Taps to each side of a pixel. At large disparities the outer views of a window lie beyond and don't count."""
PHASE = 0.25
"""Distance of a fine sample from its coarse sample, in LR pixels, at scale 2."""
NEAR = 1.6
"""Distance in LR pixels up to which a view's samples are used for the fine picture."""
CLOSE = 0.6
"""Distance in LR pixels at which the weight of a sample for the deviation falls to zero, linearly."""
SINGLE = 0.03
"""Assumed standard deviation of a single sample."""
SURE = 0.01
LEAST = 1e-6
"""Added to the variance, whose root has no finite slope at zero."""
BLOCK = 12
"""Rows that one filter down gives."""


class PlaneSweep(nn.Module):
    """Luma of a window of views -> a fine picture for each plane, and the deviation of the views from each other."""

    filters: Tensor
    weights: Tensor

    def __init__(self) -> None:
        super().__init__()
        taps = np.arange(-REACH, REACH + 1)
        disparities = np.array([*(-d for d in reversed(PLANES)), 0.0, *PLANES])
        self.planes = len(disparities)
        widths = np.gradient(disparities)
        filters = np.zeros((SIDE, SIDE, self.planes, 2, SIDE, len(taps)), np.float32)
        weights = np.zeros((SIDE, self.planes, SIDE, len(taps)), np.float32)
        for before in range(SIDE):
            offsets = np.arange(SIDE) - before
            place = taps - disparities[:, None, None] * offsets[:, None]  # (planes, SIDE, taps)
            weights[before] = np.clip(1 - np.abs(place) / CLOSE, 0, None)
            for after in range(SIDE - before):
                there = slice(0, before + after + 1)
                made = make_filters(disparities, widths, offsets[there], taps, reach=NEAR, phase=PHASE)
                filters[before, after][:, :, there] = made
        # Flat, as `to(memory_format=...)` takes tensors of four or five axes for pictures.
        self.register_buffer("filters", torch.from_numpy(filters).flatten(0, 1).flatten(1), persistent=False)
        """By the number of views before and after: `(SIDE^2, planes * 2 * SIDE * taps)`."""
        self.register_buffer("weights", torch.from_numpy(weights).flatten(1), persistent=False)
        """By the number of views before: `(SIDE, planes * SIDE * taps)`."""

    def forward(self, views: Tensor, rows: Tensor, cols: Tensor) -> tuple[Tensor, Tensor]:
        """`views`: `(N, SIDE*SIDE, H, W)`, row by row. Returns the fine pictures `(N, planes, 4, H, W)`, phases row by
        row, and the standard deviation of samples that are close together `(N, planes, H, W)`.
        """
        around = functional.pad(views, (REACH, REACH, REACH, REACH), mode="replicate")
        count, _, tall, wide = around.shape
        # The rows of views become one tall picture, of a row's views as channels. Filtered across it has planes as
        # channels, which is the order in memory that filtering down needs.
        lines = around.reshape(count, SIDE, SIDE, tall, wide).transpose(1, 2).flatten(2, 3)
        down = self._select(rows)
        parts = [_filter(lines, down, across) for across in self._select(cols).unbind(1)]
        fine = torch.stack(parts, 3).flatten(2, 3)
        down, across = self._weigh(rows), self._weigh(cols)
        mean, square = (_filter(part, down, across[:, 0])[:, :, 0] for part in (lines, lines * lines))
        variance = (square - mean * mean).clamp(min=0)
        # Few samples agree by chance, and one with itself for certain.
        few = ((down**2).sum((1, 2, 3)) * (across**2).sum((1, 2, 3)))[:, None, None]
        variance = (variance + few * SINGLE**2) / (1 - few + SURE)
        return fine, (variance + LEAST).sqrt()

    def _select(self, there: Tensor) -> Tensor:
        """The filters `(planes, 2, SIDE, taps)` for the views that are `there`, see `LightFieldGenerator`."""
        before, after = count_sides(there)
        return self.filters.index_select(0, (before * SIDE + after).reshape(1)).reshape(self.planes, 2, SIDE, -1)

    def _weigh(self, there: Tensor) -> Tensor:
        """The weights of samples in the deviation `(planes, 1, SIDE, taps)`, which add up to 1 for each plane."""
        before = count_sides(there)[0].reshape(1)
        weight = self.weights.index_select(0, before).reshape(self.planes, SIDE, -1) * (there > 0)[:, None]
        return (weight / weight.sum((1, 2), keepdim=True))[:, None]


def count_sides(there: Tensor) -> tuple[Tensor, Tensor]:
    """How many views are before the view itself, and how many after it: whole numbers."""
    before = there.argmax()
    return before, (there > 0).sum() - 1 - before


def _filter(lines: Tensor, down: Tensor, across: Tensor) -> Tensor:
    """`(N, SIDE, SIDE*tall, wide)` by filters `(planes, phases, SIDE, taps)` and `(planes, SIDE, taps)`; returns
    `(N, planes, phases, H, W)`.
    """
    planes, phases, _, taps = down.shape
    moved = functional.conv2d(lines, across[:, :, None])
    tall, wide = moved.shape[2] // SIDE, moved.shape[3]
    moved = moved.reshape(len(moved), planes * SIDE, tall, wide)
    moved = functional.pad(moved, (0, 0, 0, BLOCK - 1))
    made = functional.conv2d(moved, _repeat_in_block(down), stride=(BLOCK, 1), groups=planes)
    made = made.reshape(len(made), planes, phases, BLOCK, -1, wide).transpose(3, 4)
    return made.flatten(3, 4)[:, :, :, : tall - taps + 1]


def _repeat_in_block(down: Tensor) -> Tensor:
    """Filters `(planes, phases, SIDE, taps)` for blocks of `BLOCK` rows: `(planes*phases*BLOCK, SIDE, rows, 1)`.

    A block's rows are channels of one convolution, the taps of each moved down by its place. That is more
    multiplications, by zeros, and equal but for the order of sums; onnxruntime takes half the time for it, as it copies
    far less.
    """
    taps = down.shape[-1]
    tap = torch.arange(BLOCK + taps - 1) - torch.arange(BLOCK)[:, None]
    tap = torch.where((tap >= 0) & (tap < taps), tap, taps).to(down.device)  # (BLOCK, rows); `taps`: a zero
    return functional.pad(down, (0, 1))[..., tap].transpose(2, 3).flatten(0, 2)[..., None]
