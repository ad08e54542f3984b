"""Validation of a light-field network during training: Y-PSNR of the middle view of a light field."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import torch

from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.light_field.planes import REACH, describe_window
from ciir.training.data.downscale import KINDS
from ciir.training.data.light_field.views import degrade_views, read_views
from ciir.training.evaluation.light_fields import upscale_by_network
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma
from ciir.training.networks.collapsible import CollapsibleConv

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from torch import nn

    from ciir.models.light_field.planes import Range
    from ciir.models.light_field.windows import Axis
    from ciir.training.data.downscale import Pair
    from ciir.training.networks.light_field import LightFieldGenerator

AROUND = 4
"""Most input pixels that interpolation and the guard reach on each side."""
WIDEST = 120
"""Largest overlap of tiles, input pixels. Tiles of `models.sessions.TILE_PIXELS` then still have a part to keep."""


class _NetworkInTraining(LightFieldNetwork):
    """A network in training, called as an exported one."""

    def __init__(self, network: nn.Module) -> None:
        self.name, self.scale, self.threads = "network", 2, 1
        self._module, self._device = network, next(network.parameters()).device
        layers = sum(isinstance(module, CollapsibleConv) for module in network.modules())
        self.radius = min(WIDEST, REACH + AROUND + layers)

    def __call__(
        self,
        image: NDArray[np.float32],
        around: NDArray[np.float32],
        rows: Axis,
        cols: Axis,
        disparities: Range,
        *,
        cores: int | None = None,  # noqa: ARG002 - torch uses all of them
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """See `LightFieldNetwork.__call__`; the uncertainty is zero."""
        window = describe_window(rows, cols, disparities, cast("LightFieldGenerator", self._module).planes)
        inputs = (torch.from_numpy(part.copy()).to(self._device) for part in (image, around, *window))
        made: NDArray[np.float32] = self._module(*inputs).clamp(0, 1).cpu().numpy()
        return made, np.zeros_like(image[:, :1])


def read_light_field(folder: Path, scale: int) -> list[Pair]:
    """Reads the light field in `folder` and degrades it in each way of `KINDS`.

    Raises `ValueError` as `read_views` does.
    """
    views = read_views(folder)
    middle = tuple(slice(max(0, count // 2 - 2), count // 2 + 3) for count in views.shape[:2])
    return [degrade_views(views[middle], kind, scale) for kind in KINDS]


@torch.no_grad()
def validate_network(network: nn.Module, against: list[Pair]) -> float:
    """Returns the mean Y-PSNR in dB of the middle view over all degradations, with a border of 2 cut.

    It is upscaled as by `training.evaluation.light_fields.upscale_by_network`, so that disparities are measured as by
    `ciir reconstruct`.
    """
    network.eval()
    called = _NetworkInTraining(network)
    scores = []
    for low, high in against:
        grid = (low.shape[0], low.shape[1])
        middle = (grid[0] // 2, grid[1] // 2)
        views = {(v, u): low[v, u] for v in range(grid[0]) for u in range(grid[1])}
        made, _ = upscale_by_network(called, views, [middle], grid)
        scores.append(compute_psnr(rgb_to_luma(made[0].astype(np.uint8)), rgb_to_luma(high[middle]), border=2))
    network.train()
    return sum(scores) / len(scores)
