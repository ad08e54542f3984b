"""VDSR, 20 convolutions on the interpolated picture (Kim et al., CVPR 2016)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.interpolation import Bicubic


class VDSR(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        large = bicubic(image)
        image = large + conv(ReLU(conv(... ReLU(conv(large)))))      colours -> 64 -> ... -> 64 -> colours, all 3x3

    The original works on Y (`colours = 1`: 665 thousand weights). The initial weights are He's, except that the last
    convolution starts from a hundredth of them, so that the network is close to bicubic interpolation.
    """

    def __init__(self, layers: int = 20, channels: int = 64, scale: int = 2, colours: int = 3) -> None:
        super().__init__()
        self.scale = scale
        self.base = Bicubic(scale, colours)
        self.body = nn.Sequential()
        inputs = colours
        for _ in range(layers - 1):
            self.body.extend([nn.Conv2d(inputs, channels, kernel_size=3, padding=1), nn.ReLU()])
            inputs = channels
        self.tail = nn.Conv2d(inputs, colours, kernel_size=3, padding=1)
        for module in (*self.body, self.tail):
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight)
                nn.init.zeros_(module.bias)  # type: ignore[arg-type]
        nn.init.normal_(self.tail.weight, std=0.01 * (2.0 / (9 * inputs)) ** 0.5)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        large = functional.pixel_shuffle(self.base(image), self.scale)
        change: Tensor = self.tail(self.body(large))
        return large + change
