"""The generators, one file each, and the names by which recipes ask for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from training.networks.lite import LiteGenerator

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import nn

NETWORKS: dict[str, Callable[..., nn.Module]] = {"lite": LiteGenerator}
"""Recipe name -> constructor; the recipe's other `[network]` keys are its keyword arguments."""

__all__ = ["NETWORKS", "LiteGenerator"]
