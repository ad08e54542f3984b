"""A plane sweep that keeps sub-pixel detail: what the views around one would make of it, plane after plane.

For each hypothesis of a disparity every view's samples are put where they then lie in the view that is looked for, on a
grid twice as fine ("shift and add", Ur and Gross, CVGIP 54(2), 1992; space sweep: Collins, CVPR 1996). At the right
hypothesis the samples of all views interleave to a finer picture and agree; at a wrong one they scatter. Both are told.

Shifts go along rows and columns one after the other. Which samples count is the same for every window; how much each
does follows from which rows and columns of views are there. So one network serves the border of the grid, too.
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

    weights: Tensor
    order: Tensor

    def __init__(self, planes: int) -> None:
        """`planes`: disparities from -`MOST` to `MOST`, evenly."""
        super().__init__()
        taps = torch.arange(-REACH, REACH + 1) - torch.tensor([-PHASE, PHASE])[:, None, None]
        moved = torch.linspace(-MOST, MOST, planes)[:, None, None, None] * torch.arange(SIDE).sub(SIDE // 2)[:, None]
        self.register_buffer("weights", (1 - (taps - moved).abs() / NEAR).clamp(min=0), persistent=False)
        self.used = [[(int(v), int(tap)) for v, tap in plane.amax(0).nonzero()] for plane in self.weights]
        """Of each plane, the row or column of views and the tap of those samples that count at all."""
        most = max(len(plane) for plane in self.used)
        places = [[v * (2 * REACH + 1) + tap for v, tap in plane] for plane in self.used]
        order = torch.tensor([plane + plane[:1] * (most - len(plane)) for plane in places])
        self.register_buffer("order", order[:, None], persistent=False)

    def kernel(self, there: Tensor) -> Tensor:
        """`there`: `(SIDE,)`, see `LightFieldGenerator` -> `(planes, 2, SIDE, 2*REACH+1)`, which adds up to 1 for each
        plane and phase: how much each view's samples around a pixel count."""
        weight = self.weights * there[:, None]
        return weight / weight.sum((2, 3), keepdim=True)

    def forward(self, views: Tensor, rows: Tensor, cols: Tensor) -> tuple[Tensor, Tensor]:
        """`views`: `(N, SIDE*SIDE, H, W)`, row by row. Returns the mean `(N, planes, 4, H, W)`, phases row by row, and
        the standard deviation about it `(N, planes, H, W)`, root mean square over the phases.
        """
        count, _, height, width = views.shape
        planes = len(self.used)
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

    def _shifted(self, columns: Tensor, down: Tensor, across: Tensor, shape: tuple[int, ...]) -> Tensor:
        """`(N*SIDE, SIDE, tall, wide)` by kernels `(planes, phases, SIDE, taps)` -> `(N, planes*phases^2, H, W)`."""
        planes, phases, _, taps = down.shape
        height, width = shape[-2:]
        moved = functional.conv2d(columns, down.reshape(planes * phases, SIDE, taps, 1))
        parts = torch.split(moved.reshape(-1, SIDE * planes * phases, height, width + taps - 1), phases, 1)
        # One of nine taps counts: a convolution would take all of them, and three times as long.
        weights = across.reshape(planes, phases, SIDE * taps).gather(2, self.order.expand(-1, phases, -1))
        every = torch.eye(phases, device=weights.device)[:, None, None, :] * weights[:, None, :, :, None]
        kernels = torch.split(every.reshape(planes * phases**2, -1, 1, 1), phases**2)
        made = []
        for plane, used in enumerate(self.used):
            samples = torch.cat([parts[u * planes + plane][..., tap : tap + width] for u, tap in used], 1)
            made.append(functional.conv2d(samples, kernels[plane][:, : samples.shape[1]]))
        return torch.cat(made, 1)
