"""Batch normalisation (Ioffe and Szegedy, ICML 2015) and its folding into convolutions after training."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import TYPE_CHECKING

from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

if TYPE_CHECKING:
    from typing import TypeVar

    Network = TypeVar("Network", bound=nn.Module)


def add_batch_norm(convolution: nn.Conv2d) -> nn.Sequential:
    """Appends batch normalisation to a convolution."""
    return nn.Sequential(convolution, nn.BatchNorm2d(convolution.out_channels))


def fold_batch_norm(network: Network) -> Network:
    """Returns a copy of `network` in evaluation mode, with batch normalisation folded into the convolutions.

    Its output equals that of `network` in evaluation mode up to float32 rounding.
    """
    network = copy.deepcopy(network).eval()
    for module in network.modules():
        if isinstance(module, nn.Sequential):
            for index, (first, second) in enumerate(pairwise(list(module))):
                if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
                    module[index] = fuse_conv_bn_eval(first, second)
                    module[index + 1] = nn.Identity()
    return network
