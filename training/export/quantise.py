"""Static int8 quantisation after training: grids from a float network's values on real views, layers kept in float.

Each tensor gets the grid with the least squared error on samples of its values (as in Banner et al., NeurIPS 2019; the
clipping is searched for). A LeakyReLU's input gets the grid that does best after the LeakyReLU. As long as all layers
together cost more than `LIMIT`, the layer that costs most for each multiply-add goes back to float.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import onnx
from tqdm import tqdm

from ciir.cores import count_available_cores
from ciir.models.sessions import open_session
from ciir.training.evaluation.metrics import rgb_to_luma
from ciir.training.export import qdq
from ciir.training.export.qdq import Grid

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from ciir.training.export.calibration import Example

    Values = NDArray[np.float32]

LIMIT = 0.08
"""Most dB of Y-PSNR that int8 may lose on average over the views used for calibration."""
SAMPLES = 1 << 17
"""Number of values of each tensor from which its grid is chosen, taken evenly from all views."""
CLIPPINGS = np.linspace(0.2, 1.0, 17)
"""The shares of the extremes that a grid may span, below and above zero."""


def quantise_network(weights: bytes, pairs: Sequence[Example]) -> tuple[bytes, list[str]]:
    """Quantises a float network. Returns its int8 twin as ONNX and the names of the layers kept in float.

    `weights`: as made by `to_onnx.convert_network`. `pairs`: from `training.export.calibration`.

    Raises `ValueError` if the network has no convolution that can run in 8 bits, or int8 costs too much accuracy.
    """
    model = onnx.load_from_string(weights)
    names = [layer.name for layer in qdq.find_layers(model)]
    if not names:
        raise ValueError("int8: the network has no plain convolution, which is what runs in 8 bits; ship it as float")
    grids = choose_grids(model, pairs)
    kept: list[str] = []
    order: list[str] = []
    before = _score(weights, pairs, is_int8=False)
    while True:
        made = _serialise(qdq.insert_qdq(model, grids, kept))
        loss = float(np.mean(before - _score(made, pairs)))
        if loss <= LIMIT:
            return made, kept
        order = order or _sort_by_cost(model, grids, names, before, pairs)
        if len(kept) == len(names) - 1:
            raise ValueError(f"int8: {loss:.2f} dB are lost whatever stays in float; ship the network as float")
        kept.append(order[len(kept)])


def choose_grids(model: onnx.ModelProto, pairs: Sequence[Example]) -> dict[str, Grid]:
    """Chooses a grid for each tensor that `qdq.insert_qdq` needs."""
    layers = qdq.find_layers(model)
    image = model.graph.input[0].name
    tensors = list(dict.fromkeys(name for layer in layers for name in layer.tensors if name != image))
    samples = _sample_tensors(model, tensors, pairs)
    grids = {image: Grid.over(0.0, 1.0)}
    for layer in layers:
        leaky = layer.activation if layer.activation is not None and layer.activation.op_type == "LeakyRelu" else None
        for name in layer.tensors:
            if name not in grids:
                behind = leaky is not None and name == leaky.input[0]
                grids[name] = _choose_grid(
                    samples[name], _make_leaky(leaky) if leaky is not None and behind else _identity
                )
    return grids


class _Sample(NamedTuple):
    """A sample of a tensor's values over all views, and the extremes of all values."""

    values: Values
    low: float
    high: float


def _sample_tensors(model: onnx.ModelProto, tensors: Sequence[str], pairs: Sequence[Example]) -> dict[str, _Sample]:
    probe = onnx.ModelProto()
    probe.CopyFrom(model)
    del probe.graph.output[:]
    probe.graph.output.extend(onnx.helper.make_empty_tensor_value_info(name) for name in tensors)
    session = open_session(probe.SerializeToString(), count_available_cores())
    random = np.random.default_rng(0)
    found: dict[str, list[_Sample]] = {name: [] for name in tensors}
    for inputs, _ in tqdm(pairs, desc="calibrating", disable=None, unit="view", leave=False):
        for name, values in zip(tensors, session.run(None, inputs), strict=True):
            some = values.ravel()[random.integers(0, values.size, SAMPLES // len(pairs) + 1)]
            found[name].append(_Sample(some, float(values.min()), float(values.max())))
    return {
        name: _Sample(np.concatenate([p.values for p in parts]), min(p.low for p in parts), max(p.high for p in parts))
        for name, parts in found.items()
    }


def _choose_grid(sample: _Sample, after: Callable[[Values], Values]) -> Grid:
    """Chooses the grid, over a part of the range, that changes `after(values)` with the least squared error."""
    values = sample.values
    wanted = after(values)
    grids = dict.fromkeys(Grid.over(low, high) for low in CLIPPINGS * sample.low for high in CLIPPINGS * sample.high)
    return min(grids, key=lambda grid: float(np.square(after(grid.round(values)) - wanted).mean()))


def _identity(values: Values) -> Values:
    return values


def _make_leaky(node: onnx.NodeProto) -> Callable[[Values], Values]:
    slope = np.float32(onnx.helper.get_attribute_value(node.attribute[0]) if node.attribute else 0.01)
    return lambda values: np.where(values > 0, values, slope * values)


def _sort_by_cost(
    model: onnx.ModelProto, grids: dict[str, Grid], names: Sequence[str], before: Values, pairs: Sequence[Example]
) -> list[str]:
    """Sorts layers by the dB that their 8 bits cost for each weight, the most expensive first."""
    sizes = {value.name: int(np.prod(value.dims)) for value in model.graph.initializer}

    def cost(name: str) -> float:
        alone = qdq.insert_qdq(model, grids, [other for other in names if other != name])
        return float(np.mean(before - _score(_serialise(alone), pairs))) / sizes[name]

    return sorted(names, key=cost, reverse=True)


def _score(weights: bytes, pairs: Sequence[Example], *, is_int8: bool = True) -> Values:
    """Computes Y-PSNR in dB of each pair, with outputs not rounded, and at most 60 dB."""
    session = open_session(weights, count_available_cores(), is_int8=is_int8)
    scores = []
    for inputs, high in pairs:
        output, *_ = session.run(None, inputs)
        error = rgb_to_luma(255 * np.clip(output[0], 0, 1).transpose(1, 2, 0)) - rgb_to_luma(high)
        scores.append(min(60.0, 10 * np.log10(255**2 / max(1e-9, float(np.square(error).mean())))))
    return np.array(scores, np.float32)


def _serialise(model: onnx.ModelProto) -> bytes:
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())
