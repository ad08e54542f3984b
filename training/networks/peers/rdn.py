"""RDN, the residual dense network, D = 16, C = 8, G = G0 = 64 (Zhang et al., CVPR 2018)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ciir.training.networks.interpolation import count_doublings
from ciir.training.networks.lite import conv3x3


class ResidualDenseBlock(nn.Module):
    """`(N, base, H, W)` -> the same shape. Each of `layers` convolutions sees the outputs of all before it (section
    3.2).
    """

    def __init__(self, base: int, growth: int, layers: int) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(conv3x3(base + i * growth, growth) for i in range(layers))
        self.fusion = nn.Conv2d(base + layers * growth, base, kernel_size=1)
        self.activation = nn.ReLU()

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        dense = x
        for convolution in self.convolutions:
            dense = torch.cat([dense, self.activation(convolution(dense))], dim=1)
        change: Tensor = self.fusion(dense)
        return x + change


class RDN(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`; `scale` 2 or 4.

    ::

        first = conv(image)                                          3 -> G0
        x_i   = block_i(x_{i-1}),   x_0 = conv(first)                G0 -> G0, D times
        body  = first + conv(conv1x1([x_1, ..., x_D]))               global fusion
        image = conv(PixelShuffle_2(conv(body)))                     G0 -> 4 G -> G -> 3

    It has 22.1 million parameters at x2. The initial weights are torch's own.
    """

    def __init__(
        self,
        blocks: int = 16,
        layers: int = 8,
        growth: int = 64,
        base: int = 64,
        *,
        scale: int = 2,
    ) -> None:
        """`blocks`, `layers`, `growth` and `base` are the paper's D, C, G and G0."""
        super().__init__()
        self.scale = scale
        self.first = conv3x3(3, base)
        self.second = conv3x3(base, base)
        self.blocks = nn.ModuleList(ResidualDenseBlock(base, growth, layers) for _ in range(blocks))
        self.fusion = nn.Sequential(nn.Conv2d(blocks * base, base, kernel_size=1), conv3x3(base, base))
        self.upscaled = nn.Sequential()
        inputs = base
        for _ in range(count_doublings(scale)):
            self.upscaled.extend([conv3x3(inputs, 4 * growth), nn.PixelShuffle(2)])
            inputs = growth
        self.tail = conv3x3(growth, 3)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        first = self.first(image)
        x = self.second(first)
        outputs = []
        for block in self.blocks:
            x = block(x)
            outputs.append(x)
        body = first + self.fusion(torch.cat(outputs, dim=1))
        output: Tensor = self.tail(self.upscaled(body))
        return output
