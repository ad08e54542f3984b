"""How large values grow inside a network, and how much room number formats leave above them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.networks import in_torch, shipped
from ciir.benchmarks.stress.networks import patterns as made
from ciir.benchmarks.stress.networks.shipped import peak, worst

if TYPE_CHECKING:
    from collections.abc import Iterator

    from onnx import NodeProto

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 32
FLOAT16 = 65504.0
"""The largest float16."""
HEADROOM = 64.0
"""How many times larger than anything met float16's limit must be: sums on the way to a value may pass it by as much as
a filter has entries of either sign, and other weights of the same design by a little."""
GROWTH = 16.0
"""How many times a layer may enlarge the largest value. Four such layers in a row would reach `FLOAT16` from 1."""
PICTURES = 0.01
"""Share of a tensor's values that may lie on the ends of its int8 grid for pictures: grids are chosen for least squared
error, which cuts rare values, and one in a hundred is no longer rare."""
PATTERNS = 0.75
"""The same for patterns: at least a quarter of the values still tells inputs apart. What cutting does to the result is
bounded in `signals.against_float`."""


def inputs() -> tuple[list[str], Values]:
    """Pictures and patterns, the names of both."""
    given = {**made.pictures(SIDE), **made.patterns(SIDE, SIDE)}
    return list(given), np.stack(list(given.values()))


def activations(effort: Effort) -> Iterator[Found | Skipped]:
    """The largest value of each convolution's output on pictures and patterns, and its growth from layer to layer."""
    if missing := in_torch.missing():
        yield Skipped("activations", missing)
        return
    names, images = inputs()
    for name in shipped.floats(effort):
        weights = shipped.weights(name)
        layers = [node.output[0] for node in shipped.nodes(weights) if node.op_type in ("Conv", "ConvTranspose")]
        inside = shipped.looking_inside(weights, layers)(images)
        largest = {layer: worst(peak(values.astype(np.float32)), names) for layer, values in inside.items()}
        all_layers = ", ".join(f"{value:.1f}" for value, _ in largest.values())
        value, where = max(largest.values())
        yield Found(f"{name}: largest value of any layer", FLOAT16 / HEADROOM, value, f"{where}; layers: {all_layers}")
        before = _before(shipped.nodes(weights), layers)
        growth = {layer: largest[layer][0] / (largest[before[layer]][0] if before[layer] else 1) for layer in layers}
        layer = max(growth, key=lambda key: growth[key])
        yield Found(f"{name}: growth of the largest value over one layer", GROWTH, growth[layer], layer)


def saturation(effort: Effort) -> Iterator[Found | Skipped]:
    """The share of each int8 tensor's values that lie on the ends of its grid, on pictures and on patterns."""
    if missing := in_torch.missing():
        yield Skipped("saturation", missing)
        return
    names, images = inputs()
    count = len(made.pictures(SIDE))  # they come first
    for _, name in shipped.twins(effort):
        weights = shipped.weights(name)
        rounding = [node for node in shipped.nodes(weights) if node.op_type == "QuantizeLinear"]
        rounding = rounding[1:]  # the first is the picture itself, whose grid is its 256 levels
        asked = [text for node in rounding for text in (node.output[0], node.input[2])]
        inside = shipped.looking_inside(weights, asked)(images)
        shares = {}
        for node in rounding:
            codes, zero = inside[node.output[0]], int(inside[node.input[2]])
            # Where zero has code 0, that code is what Relu makes of all below, as it would in float.
            ends = (codes == 255) | ((codes == 0) & (zero > 0))
            shares[node.output[0]] = ends.mean(axis=(1, 2, 3))
        for kind, bound, part in (("pictures", PICTURES, slice(count)), ("patterns", PATTERNS, slice(count, None))):
            found = {tensor: worst(np.asarray(share[part]), names[part]) for tensor, share in shares.items()}
            tensor = max(found, key=lambda key: found[key][0])
            measured, where = found[tensor]
            what = f"{name}: share of a tensor at the ends of int8, {kind}"
            yield Found(what, bound, measured, f"{tensor}, {where}")


def _before(nodes: list[NodeProto], layers: list[str]) -> dict[str, str]:
    """For each of `layers` the nearest one upstream along first inputs; empty where the picture comes first."""
    first = {node.output[0]: node.input[0] for node in nodes if node.input}
    found = {}
    for layer in layers:
        tensor = first[layer]
        while tensor in first and tensor not in layers:
            tensor = first[tensor]
        found[layer] = tensor if tensor in layers else ""
    return found


CASES: tuple[Case, ...] = (activations, saturation)
