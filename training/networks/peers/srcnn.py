"""SRCNN, 9-5-5 (Dong et al., IEEE TPAMI 38(2), 2016; the first version ECCV 2014)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.interpolation import Bicubic


class SRCNN(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        large = bicubic(image)
        image = conv5x5(ReLU(conv5x5(ReLU(conv9x9(large)))))         colours -> 64 -> 32 -> colours

    The original works on Y (`colours = 1`, 57,184 weights). The initial weights are He's. Zero padding keeps the size.
    """

    def __init__(self, scale: int = 2, colours: int = 3) -> None:
        super().__init__()
        self.scale = scale
        self.base = Bicubic(scale, colours)
        self.extract = nn.Conv2d(colours, 64, kernel_size=9, padding=4)
        self.map = nn.Conv2d(64, 32, kernel_size=5, padding=2)
        self.reconstruct = nn.Conv2d(32, colours, kernel_size=5, padding=2)
        self.activation = nn.ReLU()
        for convolution in (self.extract, self.map, self.reconstruct):
            nn.init.kaiming_normal_(convolution.weight)
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        large = functional.pixel_shuffle(self.base(image), self.scale)
        features = self.activation(self.map(self.activation(self.extract(large))))
        output: Tensor = self.reconstruct(features)
        return output
