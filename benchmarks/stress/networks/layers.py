"""Measures how large values grow inside a network, and the margin up to the limits of number formats."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, skip_without
from ciir.benchmarks.stress.networks import patterns, shipped
from ciir.benchmarks.stress.networks.shipped import find_worst, peak

if TYPE_CHECKING:
    from collections.abc import Iterator

    from onnx import NodeProto

    from ciir.benchmarks.stress.case import Case, Effort, Skipped
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 32
FLOAT16 = 65504.0
"""The largest float16."""
HEADROOM = 64.0
"""How many times larger float16's limit must be than any value that occurs. Sums on the way to a value may exceed it by
as much as a filter has entries of either sign, and other weights of the same design by a little."""
GROWTH = 32.0
"""How many times the largest value may grow in one layer. Three such layers in a row would reach half of `FLOAT16` from
1."""
PICTURES = 0.01
"""Share of a tensor's values that may lie on the ends of its int8 grid for pictures. Grids are chosen for least squared
error, which cuts rare values, and one in a hundred is no longer rare."""
PATTERNS = 0.75
"""The share for patterns: at least a quarter of the values still distinguishes inputs. `signals.against_float` bounds
the effect on the result."""


def make_inputs() -> tuple[list[str], Values]:
    """Returns the names of pictures and patterns, and their values."""
    inputs = {**patterns.make_pictures(SIDE), **patterns.make_patterns(SIDE, SIDE)}
    return list(inputs), np.stack(list(inputs.values()))


@skip_without("onnx", "activations")
def activations(effort: Effort) -> Iterator[Found | Skipped]:
    """Measures the largest value of each convolution's output on pictures and patterns, and its growth from layer to
    layer.
    """
    names, images = make_inputs()
    for name in shipped.list_float_networks(effort):
        weights = shipped.read_weights(name)
        layers = [node.output[0] for node in shipped.list_nodes(weights) if node.op_type in ("Conv", "ConvTranspose")]
        inside = shipped.expose_tensors(weights, layers)(images)
        peaks = {layer: peak(values.astype(np.float32)) for layer, values in inside.items()}
        largest = {layer: float(values.max()) for layer, values in peaks.items()}
        what = f"{name}: largest value of any layer"
        yield find_worst(what, FLOAT16 / HEADROOM, np.max(list(peaks.values()), axis=0), names)
        before = _find_previous(shipped.list_nodes(weights), layers)
        growth = {layer: largest[layer] / (largest[before[layer]] if before[layer] else 1) for layer in layers}
        layer = max(growth, key=lambda key: growth[key])
        yield Found(f"{name}: growth of the largest value over one layer", GROWTH, growth[layer], layer)


@skip_without("onnx", "saturation")
def saturation(effort: Effort) -> Iterator[Found | Skipped]:
    """Measures the share of each int8 tensor's values that lie on the ends of its grid, on pictures and on patterns."""
    names, images = make_inputs()
    count = len(patterns.make_pictures(SIDE))  # they come first
    for _, name in shipped.list_int8_twins(effort):
        weights = shipped.read_weights(name)
        rounding = [node for node in shipped.list_nodes(weights) if node.op_type == "QuantizeLinear"]
        rounding = rounding[1:]  # the first node is the picture itself, whose grid is its 256 levels
        tensors = [text for node in rounding for text in (node.output[0], node.input[2])]
        inside = shipped.expose_tensors(weights, tensors, is_int8=True)(images)
        shares = {}
        for node in rounding:
            codes, zero = inside[node.output[0]], int(inside[node.input[2]])
            # If zero has code 0, Relu turns everything below into that code, as it would in float.
            ends = (codes == 255) | ((codes == 0) & (zero > 0))
            shares[node.output[0]] = ends.mean(axis=(1, 2, 3))
        for kind, bound, part in (("pictures", PICTURES, slice(count)), ("patterns", PATTERNS, slice(count, None))):
            what = f"{name}: share of a tensor at the ends of int8, {kind}"
            labels = [f"{tensor}, {where}" for tensor in shares for where in names[part]]
            yield find_worst(what, bound, np.concatenate([share[part] for share in shares.values()]), labels)


def _find_previous(nodes: list[NodeProto], layers: list[str]) -> dict[str, str]:
    """Returns the nearest layer upstream of each of `layers` along first inputs; empty if the picture comes first."""
    first = {node.output[0]: node.input[0] for node in nodes if node.input}
    found = {}
    for layer in layers:
        tensor = first[layer]
        while tensor in first and tensor not in layers:
            tensor = first[tensor]
        found[layer] = tensor if tensor in layers else ""
    return found


CASES: tuple[Case, ...] = (activations, saturation)
