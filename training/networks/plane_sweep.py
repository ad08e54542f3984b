"""A plane sweep that keeps sub-pixel detail: what the views around one would make of it, plane after plane.

For each hypothesis of a disparity every view's samples are put where they then lie in the view that is looked for, on a
grid twice as fine ("shift and add", Ur and Gross, CVGIP 54(2), 1992; space sweep: Collins, CVPR 1996). At the right
hypothesis the samples of all views interleave to a finer picture and agree; at a wrong one they scatter. Both are told.

Shifts go along rows and columns one after the other, as two convolutions whose kernels follow from where the views
stand. So one network serves any window of views, at the border of the grid too.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

SIDE = 5
"""Views along each side of the window."""
MOST = 2.0
"""Largest disparity that is looked for, LR pixels from one view to the next."""
REACH = 4
"""Taps to each side of a pixel: what views two away are shifted by at most."""
PHASE = 0.25
"""A fine sample's distance from the coarse one that it is a part of, in LR pixels, at scale 2."""
NEAR = 0.5
"""How far from a fine sample a view's sample counts, falling linearly, in LR pixels: there is one of each view."""
DOUBT = 0.03
"""Standard deviation that a sample alone is taken to have."""
SURE = 0.01
LEAST = 1e-6
"""Added to the variance, whose root has no slope at zero."""


class PlaneSweep(nn.Module):
    """Luma of a window of views -> a fine picture for each plane, and how much the views differ about it."""

    planes: Tensor
    taps: Tensor

    def __init__(self, planes: int) -> None:
        """`planes`: disparities from -`MOST` to `MOST`, evenly."""
        super().__init__()
        disparities = torch.linspace(-MOST, MOST, planes)
        distances = torch.arange(-REACH, REACH + 1) - torch.tensor([-PHASE, PHASE])[:, None]
        self.register_buffer("planes", disparities[:, None, None, None], persistent=False)
        self.register_buffer("taps", distances[None, :, None, :], persistent=False)

    def kernel(self, axis: Tensor) -> Tensor:
        """`axis`: `(2, SIDE)`, see `LightFieldGenerator` -> `(planes, 2, SIDE, 2*REACH+1)`, which adds up to 1 for each
        plane and phase: how much each view's samples around a pixel count."""
        position = axis[0][None, None, :, None]
        weight = (1 - (self.taps - self.planes * position).abs() / NEAR).clamp(min=0) * axis[1][None, None, :, None]
        return weight / weight.sum((2, 3), keepdim=True)

    def forward(self, views: Tensor, rows: Tensor, cols: Tensor) -> tuple[Tensor, Tensor]:
        """`views`: `(N, SIDE*SIDE, H, W)`, row by row. Returns the mean `(N, planes, 4, H, W)`, phases row by row, and
        the standard deviation about it `(N, planes, H, W)`, root mean square over the phases.
        """
        count, _, height, width = views.shape
        planes = len(self.planes)
        down, across = self.kernel(rows), self.kernel(cols)
        around = functional.pad(views, (REACH, REACH, REACH, REACH), mode="replicate")
        tall, wide = height + 2 * REACH, width + 2 * REACH
        # Columns of views become pictures of a batch: they are all shifted down in the same way.
        columns = around.reshape(count, SIDE, SIDE, tall, wide).transpose(1, 2).reshape(count * SIDE, SIDE, tall, wide)
        mean = self._shifted(columns, down, across, (count, height, width))
        square = self._shifted(columns * columns, down.mean(1, keepdim=True), across.mean(1, keepdim=True), mean.shape)
        mean = mean.reshape(count, planes, 4, height, width)
        variance = (square.reshape(count, planes, height, width) - (mean * mean).mean(2)).clamp(min=0)
        # Few samples agree by chance, and one with itself for certain.
        few = ((down**2).sum((2, 3)).mean(1) * (across**2).sum((2, 3)).mean(1))[:, None, None]
        variance = (variance + few * DOUBT**2) / (1 - few + SURE)
        return mean, (variance + LEAST).sqrt()

    @staticmethod
    def _shifted(columns: Tensor, down: Tensor, across: Tensor, shape: tuple[int, ...]) -> Tensor:
        """`(N*SIDE, SIDE, tall, wide)` by kernels `(planes, phases, SIDE, taps)` -> `(N, planes*phases^2, H, W)`."""
        planes, phases, _, taps = down.shape
        height, width = shape[-2:]
        moved = functional.conv2d(columns, down.reshape(planes * phases, SIDE, taps, 1))
        groups = planes * phases
        moved = moved.reshape(-1, SIDE, groups, height, width + taps - 1).transpose(1, 2)
        kernel = across[:, None].expand(-1, phases, -1, -1, -1).reshape(groups * phases, SIDE, 1, taps)
        return functional.conv2d(moved.reshape(-1, groups * SIDE, height, width + taps - 1), kernel, groups=groups)
