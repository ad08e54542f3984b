"""A plane sweep that keeps sub-pixel detail: combines neighbouring views into a fine picture for each disparity.

For each hypothesis of a disparity the samples of all views are shifted to their places in the middle view, on a grid
twice as fine ("shift and add", Ur and Gross, CVGIP 54(2), 1992; space sweep: Collins, CVPR 1996). At the right
hypothesis the samples of all views interleave to a finer picture and agree; at a wrong one they scatter. The sweep
returns the mean and the deviation.

Columns and rows are shifted one after the other. Weights depend on which rows and columns of views are inside the grid.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

SIDE = 5
"""Views along each side of the window."""
MOST = 2.0
"""Largest disparity of the sweep, LR pixels from one view to the next."""
REACH = 4
"""Taps to each side of a pixel: the largest shift, of views two away."""
PHASE = 0.25
"""Distance of a fine sample from its coarse sample, in LR pixels, at scale 2."""
NEAR = 0.5
"""Distance in LR pixels at which the weight of a view's sample falls to zero, linearly: each view has one sample."""
SINGLE = 0.03
"""Assumed standard deviation of a single sample."""
SURE = 0.01
LEAST = 1e-6
"""Added to the variance, whose root has no finite slope at zero."""


class PlaneSweep(nn.Module):
    """Luma of a window of views -> a fine picture for each plane, and the deviation of the views from it."""

    weights: Tensor
    samples: Tensor
    counts: Tensor

    def __init__(self, planes: int) -> None:
        """`planes`: disparities from -`MOST` to `MOST`, evenly."""
        super().__init__()
        taps = torch.arange(-REACH, REACH + 1) - torch.tensor([-PHASE, PHASE])[:, None, None]
        moved = torch.linspace(-MOST, MOST, planes)[:, None, None, None] * torch.arange(SIDE).sub(SIDE // 2)[:, None]
        self.register_buffer("weights", (1 - (taps - moved).abs() / NEAR).clamp(min=0), persistent=False)
        used = [plane.amax(0).nonzero().tolist() for plane in self.weights]
        most = max(len(plane) for plane in used)
        # Of each plane, the row or column of views and the tap of those samples that count at all: (planes, most, 2).
        samples = torch.tensor([plane + plane[:1] * (most - len(plane)) for plane in used])
        self.register_buffer("samples", samples, persistent=False)
        counts = torch.arange(most) < torch.tensor([[len(plane)] for plane in used])
        self.register_buffer("counts", counts.float(), persistent=False)  # 0 where others have more samples

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
        planes = len(self.weights)
        down, across = self.kernel(rows), self.kernel(cols)
        around = functional.pad(views, (REACH, REACH, REACH, REACH), mode="replicate")
        # Rows of views become pictures of a batch: they are all shifted across in the same way.
        lines = around.reshape(count * SIDE, SIDE, height + 2 * REACH, width + 2 * REACH)
        mean = self._shifted(lines, down, across)
        square = self._shifted(lines * lines, down.mean(1, keepdim=True), across.mean(1, keepdim=True))
        mean = mean.reshape(count, planes, 4, height, width)
        variance = (square.reshape(count, planes, height, width) - (mean * mean).mean(2)).clamp(min=0)
        # Few samples agree by chance, and one with itself for certain.
        few = ((down**2).sum((2, 3)).mean(1) * (across**2).sum((2, 3)).mean(1))[:, None, None]
        variance = (variance + few * SINGLE**2) / (1 - few + SURE)
        return mean, (variance + LEAST).sqrt()

    def _shifted(self, lines: Tensor, down: Tensor, across: Tensor) -> Tensor:
        """`(N*SIDE, SIDE, tall, wide)` by kernels `(planes, phases, SIDE, taps)` -> `(N, planes*phases^2, H, W)`."""
        planes, phases, _, taps = down.shape
        moved = functional.conv2d(lines, across.reshape(planes * phases, SIDE, 1, taps))
        tall, width = moved.shape[-2:]
        height = tall - taps + 1
        # One of nine taps counts: a convolution would take all of them, and three times as long. Rows of pixels are
        # picked in one step: a slice for each sample takes twice as long, and the network five times as long to load.
        view, tap = self.samples.unbind(2)  # (planes, most)
        plane, phase = torch.arange(planes, device=view.device)[:, None, None], torch.arange(phases, device=view.device)
        channel = (view[..., None] * planes + plane) * phases + phase  # (planes, most, phases)
        first = channel * tall + tap[..., None]
        picked = (first.reshape(-1, 1) + torch.arange(height, device=view.device)).reshape(-1)
        samples = moved.reshape(-1, SIDE * planes * phases * tall, width).index_select(1, picked)
        weights = (
            down.reshape(planes, phases, SIDE * taps).gather(2, (view * taps + tap)[:, None].expand(-1, phases, -1))
            * self.counts[:, None]
        )  # (planes, phases, most)
        every = weights[:, :, None, :, None] * torch.eye(phases, device=weights.device)[:, None, :]
        kernels = every.reshape(planes * phases**2, -1, 1, 1)
        return functional.conv2d(samples.reshape(len(samples), -1, height, width), kernels, groups=planes)
