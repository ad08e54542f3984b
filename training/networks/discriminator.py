"""SRGAN's discriminator (Ledig et al., CVPR 2017, section 2.1.1 and figure 4), for crops of any size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor, nn

if TYPE_CHECKING:
    from collections.abc import Sequence

SLOPE = 0.2
"""Negative slope of every LeakyReLU."""


class Discriminator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> one logit for each picture, `(N,)`: above zero for real pictures.

    For each of `channels` there is a 3x3 convolution to that many channels and one of stride 2, each with batch
    normalisation (except the very first) and LeakyReLU. Two dense layers follow. They take the mean over the picture,
    so that crops may have any size (SRGAN's take a whole 96x96 crop). SRGAN's sigmoid is part of the loss.

    Batch normalisation always uses the statistics of the batch. Without `normalise`, a logit does not depend on the
    batch.
    """

    def __init__(self, channels: Sequence[int] = (64, 128, 256, 512), *, normalise: bool = True) -> None:
        super().__init__()
        self.layers = nn.ModuleList()
        inputs = 3
        for outputs in channels:
            self.layers.append(_layer(inputs, outputs, stride=1, normalise=normalise and inputs != 3))
            self.layers.append(_layer(outputs, outputs, stride=2, normalise=normalise))
            inputs = outputs
        self.judge = nn.Sequential(
            nn.AdaptiveAvgPool2d(1),
            nn.Flatten(),
            nn.Linear(inputs, 2 * inputs),
            nn.LeakyReLU(SLOPE),
            nn.Linear(2 * inputs, 1),
            nn.Flatten(0),
        )

    def features(self, image: Tensor) -> list[Tensor]:
        """Returns the activations of each convolution, `(N, C, H / s, W / s)`, with sizes rounded up; s is 1, 2, 2, 4,
        4, 8 ...
        """
        maps = []
        x = image
        for layer in self.layers:
            x = layer(x)
            maps.append(x)
        return maps

    def logits(self, features: Sequence[Tensor]) -> Tensor:
        """Computes the logits `(N,)` from the result of `features`."""
        judged: Tensor = self.judge(features[-1])
        return judged

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        return self.logits(self.features(image))


def _layer(inputs: int, outputs: int, *, stride: int, normalise: bool) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, kernel_size=3, stride=stride, padding=1, bias=not normalise)
    nn.init.kaiming_normal_(convolution.weight, a=SLOPE)
    if convolution.bias is not None:
        nn.init.zeros_(convolution.bias)
    normalisation = [nn.BatchNorm2d(outputs, track_running_stats=False)] if normalise else []
    return nn.Sequential(convolution, *normalisation, nn.LeakyReLU(SLOPE))
