"""ESRGAN's generator of 23 residual-in-residual dense blocks, RRDB (Wang et al., ECCV workshops 2018)."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.interpolation import count_doublings
from ciir.training.networks.lite import conv3x3

SLOPE = 0.2
"""Negative slope of every LeakyReLU."""
RESIDUAL = 0.2
"""Factor on the change that a block adds to its input (section 3.1)."""


class DenseBlock(nn.Module):
    """`(N, C, H, W)` -> the same shape: five convolutions, each of which sees the outputs of all before it."""

    def __init__(self, channels: int, growth: int) -> None:
        super().__init__()
        outputs = [growth] * 4 + [channels]
        self.convolutions = nn.ModuleList(conv3x3(channels + i * growth, wide) for i, wide in enumerate(outputs))
        self.activation = nn.LeakyReLU(SLOPE)
        for convolution in self.convolutions:
            nn.init.kaiming_normal_(convolution.weight, a=SLOPE)  # type: ignore[arg-type]
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
            with torch.no_grad():
                convolution.weight.mul_(0.1)  # type: ignore[operator]

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        *inner, last = self.convolutions
        dense = x
        for convolution in inner:
            dense = torch.cat([dense, self.activation(convolution(dense))], dim=1)
        change: Tensor = last(dense)
        return x + RESIDUAL * change


class RRDB(nn.Module):
    """`(N, C, H, W)` -> the same shape: three dense blocks in a row with a skip around them."""

    def __init__(self, channels: int, growth: int) -> None:
        super().__init__()
        self.dense = nn.Sequential(*(DenseBlock(channels, growth) for _ in range(3)))

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        change: Tensor = self.dense(x)
        return x + RESIDUAL * change


class RRDBGenerator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`; `scale` 2 or 4.

    ::

        head  = conv(image)                                          3 -> C
        body  = head + conv(block_23(... block_1(head)))             C -> C
        x     = LeakyReLU(conv(nearest_x2(x))), x = body at first    C -> C, once for each doubling
        image = conv(LeakyReLU(conv(x)))                             C -> C -> 3

    The published network is x4 (16.7 million parameters). For x2 the second doubling is left out.
    """

    def __init__(self, blocks: int = 23, channels: int = 64, growth: int = 32, scale: int = 2) -> None:
        super().__init__()
        self.scale = scale
        self.head = conv3x3(3, channels)
        self.blocks = nn.Sequential(*(RRDB(channels, growth) for _ in range(blocks)))
        self.body_last = conv3x3(channels, channels)
        self.upscaled = nn.ModuleList(conv3x3(channels, channels) for _ in range(count_doublings(scale)))
        self.large = conv3x3(channels, channels)
        self.tail = conv3x3(channels, 3)
        self.activation = nn.LeakyReLU(SLOPE)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        head = self.head(image)
        x = head + self.body_last(self.blocks(head))
        for convolution in self.upscaled:
            x = self.activation(convolution(functional.interpolate(x, scale_factor=2.0, mode="nearest")))
        output: Tensor = self.tail(self.activation(self.large(x)))
        return output
