"""Our generator: a chain of 3x3 convolutions at low resolution, added to bicubic interpolation before a PixelShuffle.

The identity branch of `CollapsibleConv` replaces the skips of residual blocks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.collapsible import CollapsibleConv
from ciir.training.networks.guard import limit_change
from ciir.training.networks.interpolation import Bicubic
from ciir.training.networks.rounding import RoundedReLU

if TYPE_CHECKING:
    from collections.abc import Sequence


class CompactGenerator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        x_i   = LeakyReLU(conv_i(x_{i-1})),   x_0 = image          `widths[i]` channels
        image = PixelShuffle(limit(conv(x_last)) + bicubic(image))
    """

    def __init__(
        self,
        widths: Sequence[int] = (32, 48, 48, 48, 48, 48, 48),
        scale: int = 2,
        slope: float = 0.125,
        *,
        guard: bool = False,
        rounded: bool = False,
    ) -> None:
        """`slope`: the slope of the LeakyReLU below zero. 0 makes it a ReLU, which onnxruntime fuses into int8
        convolutions. `guard`: whether the change is limited (`guard.limit_change`). `rounded`: whether activations and
        weights are rounded in training, for int8 networks (`rounding`). Raises `ValueError` if it is set without ReLUs.
        """
        super().__init__()
        self.scale, self.guard = scale, guard
        self.body = nn.Sequential()
        inputs = 3
        for width in widths:
            activation = nn.LeakyReLU(slope) if slope else nn.ReLU()
            self.body.extend([CollapsibleConv(inputs, width, gain=0.5), activation])
            inputs = width
        # The untrained network is close to bicubic interpolation.
        self.tail = CollapsibleConv(inputs, 3 * scale**2, gain=0.1)
        self.base = Bicubic(scale)
        if rounded and slope:
            raise ValueError("rounded: activations are rounded behind ReLUs; set slope = 0")
        if rounded:
            for index in range(1, len(self.body), 2):
                self.body[index] = RoundedReLU()
            for layer in (*self.body, self.tail):
                if isinstance(layer, CollapsibleConv):
                    layer.rounded = True

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        change = self.compute_change(image)
        if self.guard:
            change = limit_change(change, image)
        return functional.pixel_shuffle(change + self.base(image), self.scale)

    def compute_change(self, image: Tensor) -> Tensor:
        """Returns the change to interpolation, before its limit, `(N, 3 * scale^2, H, W)`: colours, then phases."""
        change: Tensor = self.tail(self.body(image))
        return change
