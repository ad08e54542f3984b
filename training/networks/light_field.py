"""Our light-field generator: a single-picture generator with the detail that neighbouring views add as further input.

A plane sweep (`plane_sweep`) combines the views into a fine picture for each disparity. Convolutions select a plane, or
none, for each pixel. Its fine picture replaces the interpolated base and is an input of the single-picture generator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.models.light_field.network import LUMA
from ciir.training.networks.collapsible import CollapsibleConv
from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.guard import limit_change
from ciir.training.networks.plane_sweep import PlaneSweep

if TYPE_CHECKING:
    from collections.abc import Sequence

SHARPNESS = 60.0
"""Initial penalty of a plane for each unit of standard deviation between the views."""
NO_PLANE = 0.15
"""Standard deviation above which no plane is selected initially. With 0.03, training hardly used the other views."""
PATCH = 5
"""Side of the square over which disagreement is averaged."""
FLAT = 0.02
"""Contrast below which the picture counts as flat and uncertainty is not measured."""
DESCRIBED = 6
"""Number of values that describe a window."""
CHOSEN = 5
"""Channels of the selected plane: four phases, and the deviation of the views."""
FACTORS = (2.0, 4.0)
"""Factors on differences of luma and on standard deviations, which are small compared with colours."""


class LightFieldGenerator(nn.Module):
    """Upscales one view of a light field by 2 with the help of its neighbouring views.

    `image`: the view, RGB in [0, 1], `(N, 3, H, W)`. `around`: luma (BT.601, full range) of a window of 5x5 views, row
    by row, with the view itself anywhere in it, `(N, 25, H, W)`. `down` and `across`: the filters of its rows and
    columns, `(planes, 3, 5, taps)` each. They ignore the last ones if the grid has fewer than 5. `window`: `(6,)`.
    For these three see `models.light_field.planes`.

    Content moves by `disparity * offset` pixels towards larger coordinates from `image` to a view. Returns RGB,
    nominally in [0, 1], `(N, 3, 2*H, 2*W)`.
    """

    luma: Tensor

    def __init__(
        self,
        widths: Sequence[int] = (32, 48, 48, 48, 48, 48, 48),
        slope: float = 0.0,
        width: int = 32,
        depth: int = 3,
        planes: int = 8,
        *,
        guard: bool = False,
    ) -> None:
        """`widths`, `slope`, `guard`: options of the single-picture generator. `width`, `depth`: channels, and layers
        after the first, of the part that chooses a plane. Its last layer has 5 channels fewer, which are those of the
        selected plane. `planes`: the number of disparities that are tried. Raises `ValueError` for too few.
        """
        if planes < 2 or depth < 1:
            raise ValueError(
                f"options: {planes} planes and a depth of {depth}; give at least 2 planes and a depth of 1"
            )
        super().__init__()
        self.scale = 2
        self.single = CompactGenerator(widths, self.scale, slope, guard=guard)
        """The single-picture generator. It may start from a trained one: see `training.loop.run.Run.start_from`."""
        self.planes = planes
        self.sweep = PlaneSweep()
        self.compare = nn.Sequential(CollapsibleConv(5 * planes + 3 + DESCRIBED, width), nn.ReLU())
        for layer in range(depth):
            last = width - CHOSEN if layer == depth - 1 else width
            self.compare.extend([CollapsibleConv(width, last), nn.ReLU()])
        self.choose = CollapsibleConv(width - CHOSEN, planes + 1, gain=0.1)
        self.sharpness = nn.Parameter(torch.tensor(SHARPNESS))
        self.inform = CollapsibleConv(width, widths[1], gain=0.3)
        self.factors = FACTORS
        self.merged: nn.Conv2d | None = None
        """`inform` and the single-picture generator's second layer, merged for the export: see `merge_layers`."""
        self.register_buffer("luma", torch.tensor(LUMA)[None, :, None, None], persistent=False)

    def forward(self, image: Tensor, around: Tensor, down: Tensor, across: Tensor, window: Tensor) -> Tensor:
        """See the class."""
        return self.forward_with_uncertainty(image, around, down, across, window)[0]

    def forward_with_uncertainty(
        self, image: Tensor, around: Tensor, down: Tensor, across: Tensor, window: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Returns the result of `forward`, and the uncertainty `(N, 1, H, W)`: the deviation of the views at the best
        plane divided by the contrast of the view. It is low where they show the same scene or the picture is flat, and
        1 or more where they show different scenes or noise.
        """
        with torch.autocast(image.device.type, enabled=False):  # differences of squares, and the picture itself
            fine, spread = self.sweep(around, down, across)
            own = _sum_channels(image * self.luma)
            fine = fine - own[:, None]
            base = self.single.base(image)  # (N, 12, H, W): colours, then phases
            red, green, blue = base.split(4, 1)
            alone = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue - own
            blurred = _blur(spread)
            uncertainty = _measure_uncertainty(fine, spread, own)
            against = self.sharpness * torch.cat([blurred, torch.full_like(own, NO_PLANE)], 1)
        by_fine, by_spread = self.factors
        shown = [
            _multiply(by_fine, fine.flatten(1, 2)),
            _multiply(by_spread, spread),
            image,
            window[None, :, None, None].to(own.dtype).expand(len(own), -1, *own.shape[2:]),
        ]
        compared = self.compare(torch.cat(shown, 1))
        likely = self.choose(compared).float() - against
        # Softmax by hand, because onnxruntime's own would transpose the tensor.
        likely = (likely - likely.amax(1, keepdim=True)).exp()
        chosen = likely / _sum_channels(likely)  # (N, planes + 1, H, W)
        planes, none = chosen[:, :-1], chosen[:, -1:]
        # (N, 4, H, W): chosen less interpolated
        gain = _sum_channels(planes[:, :, None] * fine)[:, 0] - (1 - none) * alone
        spread = _sum_channels(planes * spread)
        selected = torch.cat([_multiply(by_fine, gain), _multiply(by_spread, spread)], 1)
        first, activation, second, *rest = self.single.body
        features = activation(first(image))
        if self.merged is not None:
            features = activation(self.merged(torch.cat([features, compared, selected], 1)))
        else:
            features = activation(second(features) + self.inform(torch.cat([compared, selected], 1)))
        for layer in rest[1:]:
            features = layer(features)
        change = self.single.tail(features).float()
        if self.single.guard:
            change = limit_change(change, image, gain.abs().amax(1, keepdim=True))
        return functional.pixel_shuffle(change + gain.repeat(1, 3, 1, 1) + base, self.scale), uncertainty


def _measure_uncertainty(fine: Tensor, spread: Tensor, own: Tensor) -> Tensor:
    """Measures uncertainty from the views' mean minus the view `(N, planes, 4, H, W)`, their spread `(N, planes, H, W)`
    and the view's luma `(N, 1, H, W)`.
    """
    apart = (spread.square() + fine.mean(2).square()).sqrt()
    apart = _blur(apart).amin(1, keepdim=True)
    contrast = (_blur(own.square()) - _blur(own).square()).clamp(min=0).sqrt()
    return _blur(apart) / _blur(contrast).clamp(min=FLAT)


def _blur(x: Tensor) -> Tensor:
    return functional.avg_pool2d(x, PATCH, 1, PATCH // 2, count_include_pad=False)


class WithUncertainty(nn.Module):
    """A light-field generator that returns the picture and the uncertainty, as exported."""

    def __init__(self, network: LightFieldGenerator) -> None:
        super().__init__()
        self.network = network
        self.train(network.training)

    def forward(
        self, image: Tensor, around: Tensor, down: Tensor, across: Tensor, window: Tensor
    ) -> tuple[Tensor, Tensor]:
        """See `LightFieldGenerator.forward_with_uncertainty`."""
        return self.network.forward_with_uncertainty(image, around, down, across, window)


def _sum_channels(x: Tensor) -> Tensor:
    """Sums over axis 1, which is kept, by a matrix product. The order of onnxruntime's own sum depends on the numbers
    of pictures and threads, so results would depend on the batch."""
    ones = x.new_ones(1, x.shape[1])
    return (ones @ x.flatten(2)).reshape(len(x), 1, *x.shape[2:])


def _multiply(factor: float, x: Tensor) -> Tensor:
    return x if factor == 1 else factor * x


@torch.no_grad()
def fold_factors(network: LightFieldGenerator) -> None:
    """Moves the factors on inputs of a collapsed network into weights, in place."""
    by_fine, by_spread = network.factors
    head, inform = (cast("nn.Conv2d", layer) for layer in (network.compare[0], network.inform))
    planes = network.planes
    head.weight[:, : 4 * planes] *= by_fine
    head.weight[:, 4 * planes : 5 * planes] *= by_spread
    inform.weight[:, -CHOSEN:-1] *= by_fine
    inform.weight[:, -1] *= by_spread
    network.factors = (1.0, 1.0)


@torch.no_grad()
def merge_layers(network: LightFieldGenerator) -> None:
    """Merges two added convolutions of a collapsed network in place, which is faster and rounds only once in int8."""
    second, inform = (cast("nn.Conv2d", layer) for layer in (network.single.body[2], network.inform))
    both = torch.cat([second.weight, inform.weight], 1)
    network.merged = nn.Conv2d(both.shape[1], both.shape[0], kernel_size=3, padding=1)
    network.merged.weight.copy_(both)
    cast("Tensor", network.merged.bias).copy_(cast("Tensor", second.bias) + cast("Tensor", inform.bias))
    del network.inform
    network.single.body[2] = nn.Identity()
