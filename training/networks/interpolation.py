"""Bicubic interpolation and reduction as layers, for training and export, and the number of doublings of a scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.models.single.interpolation import keys_kernel
from ciir.training.networks.collapsible import replace_layers

if TYPE_CHECKING:
    from typing import TypeVar

    Network = TypeVar("Network", bound=nn.Module)


class Bicubic(nn.Module):
    """Interpolation as one convolution: `(N, C, H, W)` -> `(N, C * scale^2, H, W)`, for PixelShuffle.

    Sample k of `scale` lies (k + 1/2) / scale - 1/2 pixels from the pixel that it belongs to. At the border the
    outermost pixels are repeated.
    """

    def __init__(self, scale: int, colours: int = 3) -> None:
        """`colours`: C, the image's channels."""
        super().__init__()
        shift = (torch.arange(scale) + 0.5) / scale - 0.5
        taps = torch.from_numpy(keys_kernel((torch.arange(-2, 3) - shift[:, None]).numpy()))  # (scale, 5)
        kernel = torch.einsum("ay,bx->abyx", taps, taps).reshape(scale**2, 1, 5, 5)
        self.convolution = nn.Conv2d(colours, colours * scale**2, kernel_size=5, groups=colours, bias=False)
        self.convolution.weight = nn.Parameter(kernel.repeat(colours, 1, 1, 1), requires_grad=False)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        # In float32, because flat areas would be off by 1/500 with weights in bfloat16.
        with torch.autocast(image.device.type, enabled=False):
            output: Tensor = self.convolution(functional.pad(image, (2, 2, 2, 2), mode="replicate"))
        return output


class SeparableBicubic(nn.Module):
    """`Bicubic` as two convolutions: the same result with a third of the multiply-adds."""

    def __init__(self, base: Bicubic) -> None:
        super().__init__()
        kernel = base.convolution.weight.detach()  # (C * scale^2, 1, 5, 5), taps along y times taps along x
        colours = base.convolution.groups
        scale = math.isqrt(len(kernel) // colours)
        taps = kernel[: scale**2 : scale, 0].sum(2)  # (scale, 5); those along x sum to 1
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


class BicubicReduction(nn.Module):
    """Bicubic reduction with antialiasing (MATLAB's `imresize`) of the picture that PixelShuffle would make.

    `(N, C * scale^2, H, W)` -> `(N, C, H, W)`. At the border the outermost pixels are repeated with all their phases.
    """

    def __init__(self, scale: int, colours: int = 3) -> None:
        """`colours`: C."""
        super().__init__()
        places = np.arange(5 * scale) - 2 * scale - (scale - 1) / 2  # of five pixels' phases, seen from the middle
        taps = keys_kernel(places / scale).reshape(5, scale).T
        kernel = torch.from_numpy(taps / taps.sum()).float()
        self.down = nn.Conv2d(colours * scale**2, colours * scale, (5, 1), groups=colours, bias=False)
        self.across = nn.Conv2d(colours * scale, colours, (1, 5), groups=colours, bias=False)
        rows = torch.einsum("ay,bc->caby", kernel, torch.eye(scale))  # each phase across stays itself
        self.down.weight = nn.Parameter(
            rows.reshape(scale, scale**2, 5, 1).repeat(colours, 1, 1, 1), requires_grad=False
        )
        self.across.weight = nn.Parameter(kernel[None, :, None, :].repeat(colours, 1, 1, 1), requires_grad=False)

    def forward(self, phases: Tensor) -> Tensor:
        """See the class."""
        # In float32, for the same reason as in `Bicubic`.
        with torch.autocast(phases.device.type, enabled=False):
            padded = functional.pad(phases, (2, 2, 2, 2), mode="replicate")
            output: Tensor = self.across(self.down(padded))
        return output


def separate(network: Network) -> Network:
    """Returns a copy of `network` in which every `Bicubic` is a `SeparableBicubic`."""
    return replace_layers(network, Bicubic, SeparableBicubic)


def count_doublings(scale: int) -> int:
    """Counts doublings: 1 for scale 2, 2 for scale 4. Raises `ValueError` for any other."""
    if scale not in (2, 4):
        raise ValueError(f"scale: {scale} is neither 2 nor 4; give one of them")
    return scale // 2
