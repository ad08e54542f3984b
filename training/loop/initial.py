"""Starts a network from the weights of a shipped one, an ONNX file: checkpoints of shipped networks are not kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import onnx
import torch
from onnx import numpy_helper
from torch import nn

from ciir.training.networks.collapsible import CollapsibleConv
from ciir.training.networks.light_field import CHOSEN, FACTORS, LightFieldGenerator

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor

PREFIX = "network."
"""What the export puts before the names of a light-field network's weights."""
MERGED = "merged"


@torch.no_grad()
def load_onnx_weights(network: nn.Module, path: Path) -> None:
    """Loads the float weights in `path` into the convolutions of `network`, whose other branches stay as they are.

    The export added the branches of each `CollapsibleConv` into one kernel; here its plain kernel takes up the
    difference. Raises `ValueError` where a weight is missing or of another shape.
    """
    model = onnx.load(path)
    found = {
        value.name.removeprefix(PREFIX): torch.from_numpy(numpy_helper.to_array(value).copy())
        for value in model.graph.initializer
    }
    if isinstance(network, LightFieldGenerator) and f"{MERGED}.weight" in found:
        _split_merged(network, found)
    missing = []
    for name, layer in network.named_modules():
        if not isinstance(layer, CollapsibleConv):
            continue
        weight, bias = found.get(f"{name}.weight"), found.get(f"{name}.bias")
        if weight is None or bias is None or weight.shape != layer.kernel.shape:
            missing.append(name)
            continue
        layer.kernel.add_(weight - layer.weight())
        layer.bias.copy_(bias)
    if missing:
        raise ValueError(f"initial: {path} doesn't hold the weights of {', '.join(missing[:3])}; name another")
    for name, parameter in network.named_parameters():
        if "." not in name and name in found:  # a single number, such as `sharpness`
            parameter.copy_(found[name])


def _split_merged(network: LightFieldGenerator, found: dict[str, Tensor]) -> None:
    """Undoes `light_field.merge_layers`: two layers out of one, and factors on inputs out of weights."""
    by_fine, by_spread = FACTORS
    second = cast("CollapsibleConv", network.single.body[2])
    both = found[f"{MERGED}.weight"]
    inputs = second.kernel.shape[1]
    inform = both[:, inputs:].clone()
    inform[:, -CHOSEN:-1] /= by_fine
    inform[:, -1] /= by_spread
    head = found["compare.0.weight"].clone()
    planes = network.sweep.planes
    head[:, : 4 * planes] /= by_fine
    head[:, 4 * planes : 5 * planes] /= by_spread
    found["compare.0.weight"] = head
    found["single.body.2.weight"], found["single.body.2.bias"] = both[:, :inputs], found[f"{MERGED}.bias"]
    found["inform.weight"], found["inform.bias"] = inform, torch.zeros_like(found[f"{MERGED}.bias"])
