"""SRGAN's generator, also called SRResNet (Ledig et al., CVPR 2017, figure 4)."""

from __future__ import annotations

from torch import Tensor, nn

from ciir.training.networks.batch_norm import add_batch_norm
from ciir.training.networks.interpolation import count_doublings


class ResidualBlock(nn.Module):
    """`x + BN(conv(PReLU(BN(conv(x)))))` on `(N, C, H, W)`."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = add_batch_norm(nn.Conv2d(channels, channels, kernel_size=3, padding=1))
        self.activation = nn.PReLU(channels)
        self.second = add_batch_norm(nn.Conv2d(channels, channels, kernel_size=3, padding=1))

    def forward(self, x: Tensor) -> Tensor:
        """See the class. The shape stays the same."""
        change: Tensor = self.second(self.activation(self.first(x)))
        return x + change


class SRGANGenerator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`; `scale` 2 or 4.

    ::

        head  = PReLU(conv9x9(image))                                3 -> C
        body  = head + BN(conv(block_16(... block_1(head))))         C -> C
        x     = PReLU(PixelShuffle_2(conv(x))), x = body at first    C -> 4C -> C, once for each doubling
        image = conv9x9(x)                                           C -> 3

    The published network is x4. For x2 the second doubling is left out. Its outputs are in [-1, 1], ours in [0, 1].
    """

    def __init__(self, blocks: int = 16, channels: int = 64, scale: int = 2) -> None:
        super().__init__()
        self.scale = scale
        self.head = nn.Sequential(nn.Conv2d(3, channels, kernel_size=9, padding=4), nn.PReLU(channels))
        self.blocks = nn.Sequential(*(ResidualBlock(channels) for _ in range(blocks)))
        self.body_last = add_batch_norm(nn.Conv2d(channels, channels, kernel_size=3, padding=1))
        self.upscaled = nn.Sequential()
        for _ in range(count_doublings(scale)):
            widen = nn.Conv2d(channels, 4 * channels, kernel_size=3, padding=1)
            self.upscaled.extend([widen, nn.PixelShuffle(2), nn.PReLU(channels)])
        self.tail = nn.Conv2d(channels, 3, kernel_size=9, padding=4)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        head = self.head(image)
        body = head + self.body_last(self.blocks(head))
        output: Tensor = self.tail(self.upscaled(body))
        return output
