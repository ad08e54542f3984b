"""Our larger light-field generator: the light one and a larger single-picture one, blended for each pixel.

Where captured views differ, or objects hide each other, a good single-picture generator can be closer to the truth than
the light one. Here both make the view, and convolutions over the features of both weight them and correct the blend.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.collapsible import CollapsibleConv
from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.guard import limit_change
from ciir.training.networks.light_field import LightFieldGenerator

if TYPE_CHECKING:
    from collections.abc import Sequence

PHASES = 4
COLOURS = 3
FACTOR = 4.0
"""By which differences of luma and colours are multiplied: they are small compared with features."""

BLENDING = ("beside", "mix", "blend")
"""The parts that a light generator doesn't have."""


class BlendedGenerator(LightFieldGenerator):
    """Upscales one view of a light field by 2 with the views around it; inputs and outputs of `LightFieldGenerator`.

    ::

        image = PixelShuffle(bicubic + share * gain + limit(share * light + (1 - share) * alone + correction))

    `light` and `gain`: the light generator's change and the detail of the other views. `alone`: the change of the
    larger single-picture generator, `beside`, which isn't trained here: it starts from a trained one
    (`Recipe.initial_single`).
    """

    def __init__(
        self,
        widths: Sequence[int] = (32, 48, 48, 48, 48, 48, 48),
        slope: float = 0.0,
        width: int = 32,
        depth: int = 3,
        *,
        beside: Sequence[int] = (64,) * 10,
        mixing: Sequence[int] = (48,) * 5,
    ) -> None:
        """`widths`, `slope`, `width`, `depth`: of the light generator, guarded. `beside`: widths of the larger
        single-picture generator. `mixing`: channels of the convolutions that blend.
        """
        super().__init__(widths, slope, width, depth, guard=True)
        self.beside = CompactGenerator(beside, self.scale, slope, guard=True).requires_grad_(False)
        inputs = widths[-1] + width + beside[-1] + COLOURS * PHASES
        self.mix = nn.Sequential()
        for channels in mixing:
            self.mix.extend([CollapsibleConv(inputs, channels, gain=0.7), nn.ReLU()])
            inputs = channels
        # Untrained, the blend is close to the mean of both.
        self.blend = CollapsibleConv(inputs, (1 + COLOURS) * PHASES, gain=0.02)

    def forward_with_uncertainty(
        self, image: Tensor, around: Tensor, rows: Tensor, cols: Tensor
    ) -> tuple[Tensor, Tensor]:
        """See `LightFieldGenerator.forward_with_uncertainty`."""
        detail = self.find_detail(image, around, rows, cols)
        features, others = self.extract_features(image, detail), self.beside.body(image)
        light = limit_change(self.single.tail(features).float(), image, detail.room)
        alone = limit_change(self.beside.tail(others).float(), image)
        small = torch.cat([detail.luma_gain, detail.spread, light + detail.gain - alone], 1)
        mixed = self.blend(self.mix(torch.cat([features, detail.compared, others, FACTOR * small], 1))).float()
        share = mixed[:, :PHASES].sigmoid().repeat(1, COLOURS, 1, 1)
        change = limit_change(share * (light - alone) + alone + mixed[:, PHASES:], image, detail.room)
        return functional.pixel_shuffle(change + share * detail.gain + detail.base, self.scale), detail.uncertainty
