"""Our generator: a chain of 3x3 convolutions at low resolution, added to bicubic interpolation before a PixelShuffle.

No batch normalisation and no skips: what a residual block's skip does for training, the identity branch of
`CollapsibleConv` does, and nothing of it is left when the network runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.networks.collapsible import CollapsibleConv

if TYPE_CHECKING:
    from collections.abc import Sequence

SLOPE = 0.125
"""Negative slope of every LeakyReLU."""
CUBIC = -0.5
"""Keys' parameter, as in MATLAB's imresize."""


class Bicubic(nn.Module):
    """Interpolation as one convolution: `(N, 3, H, W)` -> `(N, 3 * scale^2, H, W)`, to be put apart by PixelShuffle.

    Sample k of `scale` lies (k + 1/2) / scale - 1/2 pixels from the pixel that it belongs to; at the border the
    outermost pixels are repeated.
    """

    def __init__(self, scale: int) -> None:
        super().__init__()
        shift = (torch.arange(scale) + 0.5) / scale - 0.5
        taps = _keys(torch.arange(-2, 3) - shift[:, None])  # (scale, 5)
        kernel = torch.einsum("ay,bx->abyx", taps, taps).reshape(scale**2, 1, 5, 5)
        self.convolution = nn.Conv2d(3, 3 * scale**2, kernel_size=5, groups=3, bias=False)
        self.convolution.weight = nn.Parameter(kernel.repeat(3, 1, 1, 1), requires_grad=False)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        # The padding is the lossless part: a weight in bfloat16 would be 1/500 off in flat areas.
        with torch.autocast(image.device.type, enabled=False):
            output: Tensor = self.convolution(functional.pad(image, (2, 2, 2, 2), mode="replicate"))
        return output


def _keys(distance: Tensor) -> Tensor:
    """Keys' cubic kernel (Keys 1981, equation 15) at `distance` in samples."""
    d = distance.abs()
    near = (CUBIC + 2) * d**3 - (CUBIC + 3) * d**2 + 1
    far = CUBIC * (d**3 - 5 * d**2 + 8 * d - 4)
    return torch.where(d <= 1, near, torch.where(d < 2, far, torch.zeros_like(d)))


class CompactGenerator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        x_i   = LeakyReLU(conv_i(x_{i-1})),   x_0 = image          `widths[i]` channels
        image = PixelShuffle(conv(x_last) + bicubic(image))

    `fast` has widths 32 and 6 times 48 (28.5 G multiply-adds for a picture of 1280x720, 124 thousand parameters once
    collapsed), `quality` 8 times 64 (61.5 G, 267 thousand).
    """

    def __init__(self, widths: Sequence[int] = (32, 48, 48, 48, 48, 48, 48), scale: int = 2) -> None:
        super().__init__()
        self.scale = scale
        self.body = nn.Sequential()
        inputs = 3
        for width in widths:
            self.body.extend([CollapsibleConv(inputs, width, gain=0.5), nn.LeakyReLU(SLOPE)])
            inputs = width
        # Untrained, the network is close to bicubic interpolation.
        self.tail = CollapsibleConv(inputs, 3 * scale**2, gain=0.1)
        self.base = Bicubic(scale)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        change: Tensor = self.tail(self.body(image))
        return functional.pixel_shuffle(change + self.base(image), self.scale)
