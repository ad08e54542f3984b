"""Validation of a light-field network during training: Y-PSNR of the middle view of a light field."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import torch

from ciir.models.light_field.network import LUMA
from ciir.models.light_field.planes import Range, describe_window
from ciir.models.light_field.windows import select_axis
from ciir.training.data.downscale import KINDS
from ciir.training.data.light_field.crops import Inputs
from ciir.training.data.light_field.views import degrade_views, read_views
from ciir.training.loop.validation import score_outputs

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from torch import nn

    from ciir.training.data.downscale import Pair
    from ciir.training.networks.light_field import LightFieldGenerator


DISPARITIES = Range(-1.0, 1.0)
"""The disparities that planes are spread over, which suit the Knights at half their size."""


def read_light_field(folder: Path, scale: int) -> list[Pair]:
    """Reads the light field in `folder` and degrades it in each way of `KINDS`.

    Raises `ValueError` as `read_views` does.
    """
    views = read_views(folder)
    middle = tuple(slice(max(0, count // 2 - 2), count // 2 + 3) for count in views.shape[:2])
    return [degrade_views(views[middle], kind, scale) for kind in KINDS]


def make_inputs(low: NDArray[np.uint8], v: int, u: int, planes: int) -> Inputs:
    """Makes the inputs of a light-field network of `planes` for view (v, u) of `(V, U, h, w, 3)`, 8-bit RGB."""
    rows, cols = select_axis(v, low.shape[0]), select_axis(u, low.shape[1])
    views = torch.from_numpy(low[np.ix_(rows.views, cols.views)]).float().div(255)
    around = (views @ torch.tensor(LUMA)).flatten(0, 1)[None]
    image = torch.from_numpy(low[v, u]).permute(2, 0, 1)[None].float().div(255)
    window = describe_window(rows, cols, DISPARITIES, planes)
    return Inputs(image, around, *(torch.from_numpy(part.copy()) for part in window))


def validate_network(network: nn.Module, against: list[Pair]) -> float:
    """Returns the mean Y-PSNR in dB of the middle view over all degradations, with a border of 2 cut."""
    planes = cast("LightFieldGenerator", network).planes
    middle = [(low, high, low.shape[0] // 2, low.shape[1] // 2) for low, high in against]
    return score_outputs(network, ((make_inputs(low, v, u, planes), high[v, u]) for low, high, v, u in middle), 2)
