"""A plane sweep that keeps sub-pixel detail: combines neighbouring views into a fine picture for each disparity.

For each hypothesis of a disparity, the samples of all views lie at known places in the view to be upscaled (space
sweep: Collins, CVPR 1996). The filters of `models.light_field.planes` combine them into a picture twice as fine. Where
the hypothesis is right, samples that lie close together agree. The sweep also returns how much they differ.

Columns and rows are filtered one after the other.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.models.light_field.windows import WINDOW_SIDE

SINGLE = 0.03
"""Assumed standard deviation of a single sample."""
SURE = 0.01
LEAST = 1e-6
"""Added to the variance, because its root has no finite slope at zero."""
BLOCK = 12
"""Number of rows that one filter along columns produces."""


class PlaneSweep(nn.Module):
    """Turns luma of a window of views into a fine picture for each plane, and the views' deviation from each other."""

    def forward(self, views: Tensor, down: Tensor, across: Tensor) -> tuple[Tensor, Tensor]:
        """Sweeps `views`, `(N, WINDOW_SIDE^2, H, W)`, row by row. `down`, `across`: the filters of the window's rows
        and columns, `(planes, 3, WINDOW_SIDE, taps)`, from `models.light_field.planes.describe_window`.

        Returns the fine pictures `(N, planes, 4, H, W)`, phases row by row, and the standard deviation of samples that
        are close together `(N, planes, H, W)`.
        """
        reach = down.shape[-1] // 2
        around = functional.pad(views, (reach, reach, reach, reach), mode="replicate")
        count, _, tall, wide = around.shape
        # The rows of views become one tall picture, with a row's views as channels. After filtering across, the planes
        # are the channels, which is the order in memory that filtering down needs.
        lines = around.reshape(count, WINDOW_SIDE, WINDOW_SIDE, tall, wide).transpose(1, 2).flatten(2, 3)
        fine_down, close_down = down[:, :2], down[:, 2:]
        fine = torch.stack([_filter(lines, fine_down, across[:, phase]) for phase in range(2)], 3).flatten(2, 3)
        close = across[:, 2]
        mean, square = (_filter(part, close_down, close)[:, :, 0] for part in (lines, lines * lines))
        variance = (square - mean * mean).clamp(min=0)
        # A few samples may agree by chance, and a single one always agrees with itself.
        few = ((close_down**2).sum((1, 2, 3)) * (close**2).sum((1, 2)))[:, None, None]
        variance = (variance + few * SINGLE**2) / (1 - few + SURE)
        return fine, (variance + LEAST).sqrt()


def _filter(lines: Tensor, down: Tensor, across: Tensor) -> Tensor:
    """Filters `(N, WINDOW_SIDE, WINDOW_SIDE*tall, wide)` with `(planes, phases, WINDOW_SIDE, taps)` down and with
    `(planes, WINDOW_SIDE, taps)` across; returns `(N, planes, phases, H, W)`.
    """
    planes, phases, _, taps = down.shape
    moved = functional.conv2d(lines, across[:, :, None])
    tall, wide = moved.shape[2] // WINDOW_SIDE, moved.shape[3]
    moved = moved.reshape(len(moved), planes * WINDOW_SIDE, tall, wide)
    moved = functional.pad(moved, (0, 0, 0, BLOCK - 1))
    made = functional.conv2d(moved, _repeat_in_block(down), stride=(BLOCK, 1), groups=planes)
    made = made.reshape(len(made), planes, phases, BLOCK, -1, wide).transpose(3, 4)
    return made.flatten(3, 4)[:, :, :, : tall - taps + 1]


def _repeat_in_block(down: Tensor) -> Tensor:
    """Rearranges filters `(planes, phases, WINDOW_SIDE, taps)` for blocks of `BLOCK` rows: `(planes*phases*BLOCK,
    WINDOW_SIDE, rows, 1)`.

    A block's rows are channels of one convolution, with the taps of each moved down by its place. This adds
    multiplications by zero, and the result is equal except for the order of sums. onnxruntime takes half the time for
    it, because it copies far less.
    """
    taps = down.shape[-1]
    tap = torch.arange(BLOCK + taps - 1) - torch.arange(BLOCK)[:, None]
    tap = torch.where((tap >= 0) & (tap < taps), tap, taps).to(down.device)  # (BLOCK, rows); `taps`: a zero
    return functional.pad(down, (0, 1))[..., tap].transpose(2, 3).flatten(0, 2)[..., None]
