"""The lite generator of Wu et al., Applied Sciences 2024, 14(2), 656 (section 2.2, figure 3).

SRGAN's generator with fewer blocks, no batch normalisation and 3x3 kernels throughout; the outputs of all residual
blocks are added into one dense sum before the body's last convolution.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ciir.training.networks.batch_norm import add_batch_norm

SCALE = 2
SLOPE = 0.2
"""Negative slope of every LeakyReLU, as in SRGAN's discriminator; the paper names the function, not the slope."""


def conv3x3(inputs: int, outputs: int) -> nn.Conv2d:
    """Makes a 3x3 convolution with stride 1 and zero padding 1, which keeps the size."""
    return nn.Conv2d(inputs, outputs, kernel_size=3, padding=1)


def _body_convolution(channels: int, batch_norm: bool) -> nn.Module:
    plain = conv3x3(channels, channels)
    return add_batch_norm(plain) if batch_norm else plain


class ResidualBlock(nn.Module):
    """`x + conv(LeakyReLU(conv(x)))` on `(N, C, H, W)`, optionally with batch normalisation after each convolution."""

    def __init__(self, channels: int, *, batch_norm: bool = False) -> None:
        super().__init__()
        self.first = _body_convolution(channels, batch_norm)
        self.activation = nn.LeakyReLU(SLOPE)
        self.second = _body_convolution(channels, batch_norm)

    def forward(self, x: Tensor) -> Tensor:
        """See the class. The shape stays the same."""
        change: Tensor = self.second(self.activation(self.first(x)))
        return x + change


class LiteGenerator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, 2H, 2W)`.

    ::

        head  = LeakyReLU(conv(image))                       3 -> C
        x_i   = block_i(x_{i-1}),   x_0 = head               C -> C, `blocks` times
        body  = head + conv(x_1 + ... + x_blocks)            dense sum, last convolution, global skip
        image = conv(LeakyReLU(conv(nearest_x2(body))))      C -> C -> 3

    The paper compares 3, 6 and 16 blocks. `batch_norm` adds batch normalisation after each convolution of the blocks
    and the body's last, as in SRGAN.
    """

    def __init__(self, blocks: int = 6, channels: int = 64, *, batch_norm: bool = False) -> None:
        super().__init__()
        self.scale = SCALE
        self.head = conv3x3(3, channels)
        self.blocks = nn.ModuleList(ResidualBlock(channels, batch_norm=batch_norm) for _ in range(blocks))
        self.body_last = _body_convolution(channels, batch_norm)
        self.upscaled = conv3x3(channels, channels)
        self.tail = conv3x3(channels, 3)
        self.activation = nn.LeakyReLU(SLOPE)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, a=SLOPE)
                nn.init.zeros_(module.bias)  # type: ignore[arg-type]
        if not batch_norm:
            self._shrink()

    def _shrink(self) -> None:
        """Keeps activations from growing: the last convolution of each block gets a tenth of He's initial weights."""
        for block in self.blocks:
            with torch.no_grad():
                block.second.weight.mul_(0.1)  # type: ignore[union-attr, operator]
        with torch.no_grad():
            # The dense sum of n nearly equal outputs is n times one of them.
            self.body_last.weight.mul_(1.0 / max(1, len(self.blocks)))  # type: ignore[operator]

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        head = self.activation(self.head(image))
        x = head
        dense = torch.zeros_like(head)
        for block in self.blocks:
            x = block(x)
            dense = dense + x
        body = head + self.body_last(dense)
        # Nearest x2. An integer size keeps the exported Resize exact for every size.
        large = nn.functional.interpolate(body, scale_factor=float(SCALE), mode="nearest")
        output: Tensor = self.tail(self.activation(self.upscaled(large)))
        return output
