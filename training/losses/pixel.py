"""Pixel losses: the mean over all samples of a distance between two pictures of the same shape."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.models.light_field.network import LUMA

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

SQUARES = 6.0
"""Weight of squares in `squared_luma`: at a difference of a sixth of the range they count as much as its size."""


def l1(output: Tensor, high: Tensor) -> Tensor:
    """Mean absolute difference, a scalar."""
    return (output - high).abs().mean()


def mse(output: Tensor, high: Tensor) -> Tensor:
    """Mean squared difference, a scalar."""
    return (output - high).square().mean()


def luma(output: Tensor, high: Tensor) -> Tensor:
    """0.3 times the mean absolute difference of RGB and 0.7 times that of Y (BT.601's weights), a scalar."""
    difference = output - high
    return 0.3 * difference.abs().mean() + 0.7 * _weigh(difference).abs().mean()


def squared_luma(output: Tensor, high: Tensor) -> Tensor:
    """`luma`, and `SQUARES` times the mean squared difference of Y, a scalar: PSNR is of squares."""
    return luma(output, high) + SQUARES * _weigh(output - high).square().mean()


def _weigh(difference: Tensor) -> Tensor:
    return (difference * difference.new_tensor(LUMA)[:, None, None]).sum(1)


LOSSES: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "l1": l1,
    "mse": mse,
    "luma": luma,
    "squared-luma": squared_luma,
}
"""A recipe's `loss` -> function of (output, high), both float of one shape, in [0, 1]."""


def find_pixel_loss(name: str) -> Callable[[Tensor, Tensor], Tensor]:
    """Finds the function that a recipe's `loss` names. Raises `ValueError` for an unknown name."""
    if name not in LOSSES:
        raise ValueError(f"loss: {name!r} is not known; give one of {', '.join(LOSSES)}")
    return LOSSES[name]
