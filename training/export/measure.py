"""Measurements for the card of a network: receptive radius, parameters, multiply-adds, tile overlap."""

from __future__ import annotations

import copy
import itertools
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from ciir.training.export import inputs as examples

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

    from ciir.models.cards import Sizes
    from ciir.training.export.inputs import WindowPosition

WIDEST = 120
"""Largest radius, input pixels. Tiles of 273x273 (`models.sessions.TILE_PIXELS`) then still have a part to keep."""
SMALL = 32
"""Side of the picture whose multiply-adds are counted, in pixels, including padding."""
OVERLAPS = (8, 16, 24, 32, 48, 64, 96)
SEAM = 0.5 / 255
"""Largest invisible difference between a tile and the whole picture: half an 8-bit level."""
KEPT = 32
"""Side of the middle part of a tile that is compared with the whole picture, in pixels."""


def count_parameters(network: nn.Module) -> int:
    """Counts the learnt parameters. Constants stored as weights, such as an interpolation kernel, don't count."""
    return sum(weight.numel() for weight in network.parameters() if weight.requires_grad)


@torch.no_grad()
def count_macs(network: nn.Module, sizes: Sizes) -> float:
    """Counts the multiply-adds of all convolutions and matrix products for one output pixel (three channels)."""
    with FlopCounterMode(display=False) as counter:
        output = network(*examples.make_examples(network, 1, *sizes.round_up(SMALL, SMALL)))
    return float(counter.get_total_flops() / 2 / output[0, 0].numel())


def find_receptive_radius(network: nn.Module, scale: int) -> int | None:
    """Finds the largest distance in input pixels at which an input pixel can change an output pixel; None if it is more
    than `WIDEST`. For networks of convolutions and activations.

    It is measured as the gradient of one input pixel's `scale x scale` outputs on a vertical and a horizontal strip.
    Every weight is replaced by a positive number, so that no paths cancel.
    """
    probe = copy.deepcopy(network).double()
    random = torch.Generator().manual_seed(0)  # equal weights would cancel where channels compete (softmax)
    with torch.no_grad():
        for weight in probe.parameters():
            if weight.ndim > 1:
                weight.copy_((0.5 + torch.rand(weight.shape, generator=random)) / weight[0].numel())
            else:
                weight.fill_(0.0 if weight.ndim else 1.0)
    for centre in (16, 32, 64, WIDEST + 1):
        tries = itertools.product(examples.list_windows(network), (2, 3))
        radius = max(_measure_reach(probe, scale, centre, axis, place) for place, axis in tries)
        if radius < centre:
            return radius
    return None


def _measure_reach(probe: nn.Module, scale: int, centre: int, axis: int, place: WindowPosition) -> int:
    """Returns how far from pixel `centre` of a strip along `axis` its outputs' gradient is not zero, in pixels."""
    sides = [9, 9]
    sides[axis - 2] = 2 * centre + 1
    inputs = [part.double() for part in examples.make_examples(probe, 1, *sides, place=place)]
    pictures = [part.requires_grad_() for part in inputs[:2]]  # the view and its neighbours
    for part in pictures[1:]:
        part.data += 1  # the neighbouring views are brighter than the view itself, so that no ReLU is zero
    output = probe(*inputs).movedim(axis, 2)[:, :, centre * scale : (centre + 1) * scale]
    gradients = torch.cat(torch.autograd.grad(output.sum(), pictures), 1)
    touched = gradients.abs().sum([i for i in range(4) if i != axis]).nonzero()
    return int((touched - centre).abs().max())


@torch.no_grad()
def find_tile_overlap(network: Callable[[Tensor], Tensor], scale: int, sizes: Sizes) -> int:
    """Finds the tile overlap in input pixels at which tiles differ from the whole picture by at most `SEAM`.

    This is for networks whose receptive field is wider than a tile, or unknown. It is measured on noise that is strong
    on one side and faint on the other, so that a tile's mean differs from the picture's.

    Raises `ValueError` if even the last of `OVERLAPS` is too small.
    """
    step = sizes.multiple_of
    rounded = sorted({-(-halo // step) * step for halo in OVERLAPS})
    kept = -(-KEPT // step) * step
    begin = 2 * rounded[-1]
    end, side = begin + kept, kept + 2 * begin
    image = torch.from_numpy(np.random.default_rng(0).random((1, 3, side, side), dtype=np.float32))
    image[..., end:] *= 0.25
    whole = network(image)
    worst = float("inf")
    for halo in rounded:
        tile = network(image[:, :, begin - halo : end + halo, begin - halo : end + halo])
        inner = slice(halo * scale, (halo + kept) * scale)
        outer = slice(begin * scale, end * scale)
        worst = float((tile[..., inner, inner] - whole[..., outer, outer]).abs().max())
        if worst <= SEAM:
            return halo
    raise ValueError(
        f"tiles that overlap by {rounded[-1]} pixels differ from the whole picture by {worst:.3f}: "
        f"its receptive field is larger; give a network of convolutions"
    )
