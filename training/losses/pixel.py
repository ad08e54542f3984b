"""Pixel losses: the mean over all samples of a distance between two pictures of the same shape."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.models.light_field.network import LUMA

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

SQUARES = 6.0
"""Weight of squares in `squared_luma`. At a sixth of the range they count as much as the absolute difference."""


def l1(output: Tensor, high: Tensor) -> Tensor:
    """Computes the mean absolute difference, a scalar."""
    return (output - high).abs().mean()


def mse(output: Tensor, high: Tensor) -> Tensor:
    """Computes the mean squared difference, a scalar."""
    return (output - high).square().mean()


def luma(output: Tensor, high: Tensor) -> Tensor:
    """Computes 0.3 times the mean absolute difference of RGB plus 0.7 times that of Y (BT.601's weights), a scalar."""
    difference = output - high
    return 0.3 * difference.abs().mean() + 0.7 * _weigh(difference).abs().mean()


def squared_luma(output: Tensor, high: Tensor) -> Tensor:
    """Computes `luma` plus `SQUARES` times the mean squared difference of Y, a scalar. PSNR depends on squares."""
    return luma(output, high) + SQUARES * _weigh(output - high).square().mean()


def _weigh(difference: Tensor) -> Tensor:
    return (difference * difference.new_tensor(LUMA)[:, None, None]).sum(1)


LOSSES: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "l1": l1,
    "mse": mse,
    "luma": luma,
    "squared-luma": squared_luma,
}
"""A recipe's `loss` -> the function of (output, high), both float of the same shape, in [0, 1]."""


def find_pixel_loss(name: str) -> Callable[[Tensor, Tensor], Tensor]:
    """Finds the function that a recipe's `loss` names. Raises `ValueError` for an unknown name."""
    if name not in LOSSES:
        raise ValueError(f"loss: {name!r} is not known; give one of {', '.join(LOSSES)}")
    return LOSSES[name]
