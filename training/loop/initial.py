"""Starts a network from the weights of a float network's ONNX file, because networks ship without checkpoints."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, cast

import onnx
import torch
from google.protobuf.message import DecodeError  # type: ignore[import-untyped]
from onnx import numpy_helper
from torch import nn

from ciir.training.networks.collapsible import CollapsibleConv
from ciir.training.networks.ensemble import Ensemble, count_members, split_weights
from ciir.training.networks.light_field import CHOSEN, FACTORS, LightFieldGenerator

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor

PREFIX = "network."
"""The prefix that the export adds to the names of a light-field network's weights."""
MERGED = "merged"
ADDED = 0.1
"""The share of its random kernel that an added layer starts with, in addition to the identity."""


@torch.no_grad()
def load_onnx_weights(network: nn.Module, path: Path) -> None:
    """Loads the float weights in `path` into the convolutions of `network`, whose other branches stay as they are.

    The export added the branches of each `CollapsibleConv` into one kernel; here its plain kernel takes up the
    difference. A light-field network loads the weights of a single-picture generator into the one that it contains, an
    ensemble into all of its members. Layers of a generator's body after the last one in the file start near the
    identity, which a ReLU keeps. They don't start exactly at it, because channels that are zero everywhere would get no
    gradient and stay zero.

    Raises `ValueError` if the file can't be read or holds an int8 network, if a weight is missing or has another shape,
    or if `network` is not made of such convolutions.
    """
    try:
        model = onnx.load(path)
    except (OSError, DecodeError) as error:
        raise ValueError(f"initial: {path}: not an ONNX file that can be read ({error}); name another") from error
    if any(node.op_type == "QuantizeLinear" for node in model.graph.node):
        raise ValueError(f"initial: {path} is an int8 network; name the float one")
    network, found = _match(network, _read_weights(model))
    layers = {name: layer for name, layer in network.named_modules() if isinstance(layer, CollapsibleConv)}
    if not layers:
        raise ValueError(f"initial: {path}: only our own generators start from an ONNX file; name a checkpoint")
    missing = []
    last = max((_place(name) for name in found), default=-1)
    for name, layer in layers.items():
        weight, bias = found.get(f"{name}.weight"), found.get(f"{name}.bias")
        if layer.identity and _place(name) > last >= 0:
            weight = nn.init.dirac_(torch.empty_like(layer.kernel)) + ADDED * layer.kernel
            bias = torch.zeros_like(layer.bias)
        if weight is None or bias is None or weight.shape != layer.kernel.shape:
            missing.append(name)
            continue
        layer.kernel.add_(weight.to(layer.kernel.device) - layer.weight())
        layer.bias.copy_(bias)
    if missing:
        raise ValueError(f"initial: {path} doesn't hold the weights of {', '.join(missing[:3])}; name another")
    for name, parameter in network.named_parameters():
        if "." not in name and name in found:  # a single number, such as `sharpness`
            parameter.copy_(found[name])


def _read_weights(model: onnx.ModelProto) -> dict[str, Tensor]:
    """Reads the weights of an exported network, by their names in it."""
    return {
        value.name.removeprefix(PREFIX): torch.from_numpy(numpy_helper.to_array(value).copy())
        for value in model.graph.initializer
    }


def _match(network: nn.Module, found: dict[str, Tensor]) -> tuple[nn.Module, dict[str, Tensor]]:
    """Returns the part of `network` that the weights `found` belong to, and the weights by their names in that part."""
    if isinstance(network, LightFieldGenerator):
        if "compare.0.weight" not in found:
            return network.single, found
        if f"{MERGED}.weight" in found:
            _split_merged(network, found)
    elif isinstance(network, Ensemble):
        there, here = count_members(found), len(network.members)
        if not there:
            return network, split_weights(found, here)
        if there != here:
            raise ValueError(
                f"initial: an ensemble of {there} generators, but members is {here}; set members = {there} in options, "
                "or name another"
            )
    return network, found


def _place(name: str) -> int:
    """Returns the number of a layer, or of its weight, in a generator's body; -1 for others."""
    found = re.search(r"\bbody\.(\d+)", name)
    return int(found[1]) if found else -1


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
    planes = network.planes
    head[:, : 4 * planes] /= by_fine
    head[:, 4 * planes : 5 * planes] /= by_spread
    found["compare.0.weight"] = head
    found["single.body.2.weight"], found["single.body.2.bias"] = both[:, :inputs], found[f"{MERGED}.bias"]
    found["inform.weight"], found["inform.bias"] = inform, torch.zeros_like(found[f"{MERGED}.bias"])
