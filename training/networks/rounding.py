"""Rounding of activations and weights during training as in int8 networks, so that networks learn to cope with it.

Gradients pass as if nothing were rounded (Jacob et al., CVPR 2018).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import nn

if TYPE_CHECKING:
    from torch import Tensor

LEVELS = 255
"""Number of steps of an activation's grid, which begins at zero."""
LARGEST = 127
"""The largest code of a weight."""


class RoundedReLU(nn.ReLU):
    """A ReLU whose output is rounded to the levels of one grid in training."""

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        output = super().forward(x)
        return round_activations(output) if self.training else output


def round_activations(x: Tensor) -> Tensor:
    """Rounds values of at least zero to the levels of one grid that ends at the largest of them."""
    values = x.float()
    step = values.detach().amax().clamp(min=1e-6) / LEVELS
    return _pass_gradient(values, (values / step).round() * step).to(x.dtype)


def round_weights(weight: Tensor) -> Tensor:
    """Rounds kernels `(outputs, inputs, h, w)` to the levels of each output's own grid."""
    step = weight.detach().abs().amax((1, 2, 3), keepdim=True).clamp(min=1e-8) / LARGEST
    return _pass_gradient(weight, (weight / step).round() * step)


def _pass_gradient(values: Tensor, rounded: Tensor) -> Tensor:
    return values + (rounded - values).detach()
