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
BLOCK = 10
"""Rows that one filter of `_filter_blocks` gives."""


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
        count, _, height, width = views.shape
        planes = self.planes
        around = functional.pad(views, (REACH, REACH, REACH, REACH), mode="replicate")
        # Rows of views become pictures of a batch: they are all filtered across in the same way.
        lines = around.reshape(count * SIDE, SIDE, height + 2 * REACH, width + 2 * REACH)
        fine = _filter(lines, self._select(rows), self._select(cols)).reshape(count, planes, 4, height, width)
        down, across = self._weigh(rows), self._weigh(cols)
        mean, square = (_filter(part, down, across) for part in (lines, lines * lines))
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
    """`(N*SIDE, SIDE, tall, wide)` by filters `(planes, phases, SIDE, taps)` -> `(N, planes*phases^2, H, W)`."""
    planes, phases, _, taps = down.shape
    moved = functional.conv2d(lines, across.reshape(planes * phases, SIDE, 1, taps))
    tall, wide = moved.shape[-2:]
    # (N, row of views, planes, phase across, tall, W) -> phases across in the batch, a group of rows for each plane
    moved = moved.reshape(-1, SIDE, planes, phases, tall, wide).permute(0, 3, 2, 1, 4, 5)
    moved = moved.reshape(-1, planes * SIDE, tall, wide)
    if phases == 1:
        return functional.conv2d(moved, down.reshape(planes, SIDE, taps, 1), groups=planes)
    made = _filter_blocks(moved, down)  # (N * phases, planes * phases * BLOCK, blocks, W)
    blocks = made.shape[2]
    made = made.reshape(-1, phases, planes, phases, BLOCK, blocks, wide).permute(0, 2, 3, 1, 5, 4, 6)
    return made.reshape(len(made), planes * phases**2, blocks * BLOCK, wide)[:, :, : tall - taps + 1]


def _filter_blocks(moved: Tensor, down: Tensor) -> Tensor:
    """`(N, planes*SIDE, tall, W)` filtered down in blocks of `BLOCK` rows: `(N, planes*phases*BLOCK, blocks, W)`.

    A block's rows are channels of one convolution, the taps of each moved down by its place. That is more
    multiplications, by zeros, and equal to the bit; onnxruntime takes half the time for it, as it copies far less.
    """
    planes, phases, _, taps = down.shape
    tap = torch.arange(BLOCK + taps - 1) - torch.arange(BLOCK)[:, None]
    tap = torch.where((tap >= 0) & (tap < taps), tap, taps).to(down.device)  # (BLOCK, rows); `taps`: a zero
    filters = functional.pad(down, (0, 1))[..., tap]  # (planes, phases, SIDE, BLOCK, rows)
    filters = filters.transpose(2, 3).reshape(planes * phases * BLOCK, SIDE, BLOCK + taps - 1, 1)
    return functional.conv2d(functional.pad(moved, (0, 0, 0, BLOCK - 1)), filters, stride=(BLOCK, 1), groups=planes)
