"""A 3x3 convolution with several branches for training that becomes one plain convolution afterwards.

As in ECBSR (Zhang et al., ACM MM 2021) and SESR (Bhardwaj et al., MLSys 2022), all branches are linear, and their
kernels are added before they are applied.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.rounding import round_weights

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeVar

    Network = TypeVar("Network", bound=nn.Module)
    Layer = TypeVar("Layer", bound=nn.Module)

WIDENING = 2
"""Number of channels in the middle of the widened branch for each output channel."""


class CollapsibleConv(nn.Module):
    """`(N, inputs, H, W)` -> `(N, outputs, H, W)`, zero padding 1: the sum of

    - a 3x3 convolution,
    - a 3x3 convolution to `WIDENING * outputs` channels and a 1x1 convolution back,
    - a 1x1 convolution,
    - and the input itself, if `inputs == outputs`.
    """

    def __init__(self, inputs: int, outputs: int, *, gain: float = 1.0) -> None:
        """`gain`: factor on the initial weights, which are He's for the branches' sum."""
        super().__init__()
        wide = WIDENING * outputs
        deviation = gain * (2.0 / (9 * inputs)) ** 0.5
        self.kernel = nn.Parameter(torch.randn(outputs, inputs, 3, 3) * deviation * 0.5**0.5)
        self.widen = nn.Parameter(torch.randn(wide, inputs, 3, 3) * (2.0 / (9 * inputs)) ** 0.5)
        self.narrow = nn.Parameter(torch.randn(outputs, wide) * gain * (0.5 / wide) ** 0.5)
        self.point = nn.Parameter(torch.zeros(outputs, inputs))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.identity = inputs == outputs
        self.rounded = False
        """Whether training rounds the kernel as the export to int8 does."""

    def weight(self) -> Tensor:
        """Computes the single kernel that equals the sum of all branches, `(outputs, inputs, 3, 3)` float32."""
        with torch.autocast(self.kernel.device.type, enabled=False):
            point = self.point + torch.eye(len(self.point), device=self.point.device) if self.identity else self.point
            centre = functional.pad(point[..., None, None], (1, 1, 1, 1))
            return self.kernel + torch.einsum("ow,wiyx->oiyx", self.narrow, self.widen) + centre

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        weight = self.weight()
        if self.rounded and self.training:
            weight = round_weights(weight)
        return functional.conv2d(x, weight, self.bias, padding=1)

    @torch.no_grad()
    def collapsed(self) -> nn.Conv2d:
        """Returns the equivalent plain convolution."""
        outputs, inputs = self.kernel.shape[:2]
        plain = nn.Conv2d(inputs, outputs, kernel_size=3, padding=1)
        plain.weight.copy_(self.weight())
        plain.bias.copy_(self.bias)  # type: ignore[union-attr]
        return plain


def collapse(network: Network) -> Network:
    """Returns a copy of `network` in which every `CollapsibleConv` is one plain convolution."""
    return replace_layers(network, CollapsibleConv, CollapsibleConv.collapsed)


@torch.no_grad()
def replace_layers(network: Network, kind: type[Layer], make: Callable[[Layer], nn.Module]) -> Network:
    """Returns a copy of `network` in which every layer of this kind is replaced by what `make` returns for it."""
    network = copy.deepcopy(network)
    for module in list(network.modules()):
        for name, child in module.named_children():
            if isinstance(child, kind):
                setattr(module, name, make(child))
    return network
