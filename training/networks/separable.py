"""Separable bicubic interpolation: the same result with a third of the multiply-adds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.collapsible import replace_layers
from ciir.training.networks.interpolation import Bicubic

if TYPE_CHECKING:
    from typing import TypeVar

    Network = TypeVar("Network", bound=nn.Module)


class SeparableBicubic(nn.Module):
    """`interpolation.Bicubic` as two convolutions, `(N, C, H, W)` -> `(N, C * scale^2, H, W)`."""

    def __init__(self, base: Bicubic) -> None:
        super().__init__()
        kernel = base.convolution.weight.detach()  # (C * scale^2, 1, 5, 5), taps along y times taps along x
        colours = base.convolution.groups
        scale = math.isqrt(len(kernel) // colours)
        taps = kernel[: scale**2 : scale, 0].sum(2)  # (scale, 5): those along x add up to 1
        self.down = nn.Conv2d(colours, colours * scale, (5, 1), groups=colours, bias=False)
        self.across = nn.Conv2d(colours * scale, colours * scale**2, (1, 5), groups=colours * scale, bias=False)
        for convolution, weight, groups in (
            (self.down, taps[:, None, :, None], colours),
            (self.across, taps[:, None, None, :], colours * scale),
        ):
            convolution.weight = nn.Parameter(weight.repeat(groups, 1, 1, 1), requires_grad=False)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        output: Tensor = self.across(self.down(functional.pad(image, (2, 2, 2, 2), mode="replicate")))
        return output


def separate(network: Network) -> Network:
    """Returns a copy of `network` in which every `Bicubic` is a `SeparableBicubic`."""
    return replace_layers(network, Bicubic, SeparableBicubic)
