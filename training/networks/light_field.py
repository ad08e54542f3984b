"""Our light-field generator: a single-picture generator that is told what the views around would make of its picture.

A plane sweep (`plane_sweep`) says for each disparity what fine picture the views make together, and how well they
agree. A few convolutions choose a plane for each pixel, or none; the chosen fine picture takes the place of the
interpolated base, and is shown to the single-picture generator, which corrects it. Where no plane suits, that one works
alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.networks.collapsible import CollapsibleConv
from training.networks.compact import CompactGenerator
from training.networks.plane_sweep import PlaneSweep

if TYPE_CHECKING:
    from collections.abc import Sequence

SHARPNESS = 60.0
"""How strongly disagreement speaks against a plane before anything is learnt, for each unit of standard deviation."""
DOUBT = 0.15
"""Standard deviation above which no plane is the better choice before anything is learnt. High on purpose: at 0.03 no
plane was chosen wherever there was texture, and training hardly came to use the other views."""
PATCH = 5
"""Side of the square over which disagreement is averaged."""
CHOSEN = 5
"""Channels of what was chosen: four phases, and how much the views differ."""
LUMA = (0.299, 0.587, 0.114)


class LightFieldGenerator(nn.Module):
    """Upscales one view of a light field by 2 with the help of those around it.

    `image`: the view, RGB in [0, 1], `(N, 3, H, W)`. `around`: luma (BT.601, full range) of a window of 5x5 views, row
    by row, which holds the view itself too, `(N, 25, H, W)`. `rows` and `cols`, `(2, 5)` each: how many views down and
    to the right of `image` each row and column of the window stands, and 1 where it is there or 0 where it is not; what
    `around` holds for those that are not there plays no part, and the view's own row and column must be there.

    Content moves by `disparity * offset` pixels towards larger coordinates from `image` to a view. Returns RGB,
    nominally in [0, 1], `(N, 3, 2*H, 2*W)`.
    """

    luma: Tensor

    def __init__(
        self,
        widths: Sequence[int] = (32, 48, 48, 48, 48, 48, 48),
        slope: float = 0.0,
        planes: int = 17,
        width: int = 32,
        depth: int = 3,
    ) -> None:
        """`widths`, `slope`: of the single-picture generator. `width`, `depth`: channels, and layers after the first,
        of what chooses a plane. Its last layer leaves room for the 5 channels of what was chosen.
        """
        super().__init__()
        self.scale = 2
        self.single = CompactGenerator(widths, self.scale, slope)
        """May start from a trained one: see `training.run.Run.start_from`."""
        self.sweep = PlaneSweep(planes)
        self.compare = nn.Sequential(CollapsibleConv(5 * planes + 3, width), nn.ReLU())
        for layer in range(depth):
            last = width - CHOSEN if layer == depth - 1 else width
            self.compare.extend([CollapsibleConv(width, last), nn.ReLU()])
        self.choose = CollapsibleConv(width - CHOSEN, planes + 1, gain=0.1)
        self.sharpness = nn.Parameter(torch.tensor(SHARPNESS))
        self.inform = CollapsibleConv(width, widths[1], gain=0.3)
        self.register_buffer("luma", torch.tensor(LUMA)[None, :, None, None], persistent=False)

    def forward(self, image: Tensor, around: Tensor, rows: Tensor, cols: Tensor) -> Tensor:
        """See the class."""
        with torch.autocast(image.device.type, enabled=False):  # differences of squares, and the picture itself
            fine, spread = self.sweep(around, rows, cols)
            own = (image * self.luma).sum(1, keepdim=True)
            fine = fine - own[:, None]
            base = self.single.base(image)  # (N, 12, H, W): colours, then phases
            red, green, blue = base.split(4, 1)
            alone = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue - own
            blurred = functional.avg_pool2d(spread, PATCH, 1, PATCH // 2, count_include_pad=False)
            against = self.sharpness * torch.cat([blurred, torch.full_like(own, DOUBT)], 1)
        compared = self.compare(torch.cat([2 * fine.flatten(1, 2), 4 * spread, image], 1))
        likely = self.choose(compared).float() - against
        likely = (
            likely - likely.amax(1, keepdim=True)
        ).exp()  # softmax, whose own layer onnxruntime turns around first
        chosen = likely / likely.sum(1, keepdim=True)  # (N, planes + 1, H, W)
        planes, none = chosen[:, :-1], chosen[:, -1:]
        gain = (planes[:, :, None] * fine).sum(1) - (1 - none) * alone  # (N, 4, H, W): chosen less interpolated
        spread = (planes * spread).sum(1, keepdim=True)
        told = self.inform(torch.cat([compared, 2 * gain, 4 * spread], 1))
        first, activation, second, *rest = self.single.body
        features = activation(second(activation(first(image))) + told)
        for layer in rest[1:]:
            features = layer(features)
        return functional.pixel_shuffle(self.single.tail(features).float() + base + gain.repeat(1, 3, 1, 1), self.scale)
