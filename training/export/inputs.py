"""The inputs of a network's ONNX file, and examples of them for exporting, comparing and measuring it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from ciir.models import cards
from ciir.models.light_field.planes import Range, describe_window
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis
from ciir.training.networks.light_field import LightFieldGenerator

if TYPE_CHECKING:
    from torch import Tensor, nn

    WindowPosition = tuple[tuple[int, int], tuple[int, int]]

FREE = ("height", "width")
IMAGE = cards.Tensor("image", ("batch", 3, *FREE), "float32", 0.0, 1.0)
UNCERTAINTY = cards.Tensor("uncertainty", ("batch", 1, *FREE), "float32", 0.0, 1.0)
"""A light-field network's output besides the picture; see `LightFieldGenerator.forward_with_uncertainty`."""
EXAMPLE = Range(-1.0, 1.0)
"""The range of disparities of examples."""
WINDOWS: tuple[WindowPosition, ...] = (((2, 5), (2, 5)), ((0, 5), (0, 5)), ((1, 3), (1, 3)), ((2, 3), (3, 5)))
"""Windows for tests of such a network, as `(position, count)` of views down and across: a whole one, one at a corner,
and those in the middle and at the edge of the smallest grid."""


def list_inputs(network: nn.Module) -> tuple[cards.Tensor, ...]:
    """Lists the inputs of the network's ONNX file, in order."""
    if not isinstance(network, LightFieldGenerator):
        return (IMAGE,)
    filters = (network.planes, 3, WINDOW_SIDE, "taps")
    return (
        IMAGE,
        cards.Tensor("around", ("batch", WINDOW_SIDE * WINDOW_SIDE, *FREE), "float32", 0.0, 1.0),
        cards.Tensor("down", filters, "float32", -2.0, 2.0),
        cards.Tensor("across", filters, "float32", -2.0, 2.0),
        cards.Tensor("window", (6,), "float32", -2.0, 2.0),
    )


def list_outputs(network: nn.Module) -> tuple[cards.Tensor, ...]:
    """Lists the outputs of the network's ONNX file after the picture."""
    return (UNCERTAINTY,) if isinstance(network, LightFieldGenerator) else ()


def list_windows(network: nn.Module) -> tuple[WindowPosition, ...]:
    """Lists the windows to test a network on. A single-picture network has one, which is ignored."""
    return WINDOWS if isinstance(network, LightFieldGenerator) else WINDOWS[:1]


def make_examples(
    network: nn.Module, count: int, height: int, width: int, *, place: WindowPosition = WINDOWS[0]
) -> list[Tensor]:
    """Makes noise in [0, 1] for each of `list_inputs`, for `count` pictures, the same in each call. `place`: the
    window's position.
    """
    random = torch.Generator().manual_seed(0)
    made = [torch.rand(count, 3, height, width, generator=random)]
    if isinstance(network, LightFieldGenerator):
        made.append(torch.rand(count, WINDOW_SIDE * WINDOW_SIDE, height, width, generator=random))
        rows, cols = (select_axis(*at) for at in place)
        made.extend(
            torch.from_numpy(part.copy()) for part in describe_window(rows, cols, EXAMPLE, network.planes).trim()
        )
    return made
