"""8-bit convolutions in an ONNX graph: QuantizeLinear and DequantizeLinear (QDQ) around the nodes that run in int8.

The graph has the form that onnxruntime calls QDQ: S8S8/U8S8 with symmetric weights and one scale for each output
channel. Activations are unsigned 8 bit, `value = scale * (code - zero)`. Biases are 32 bit with the scale of the
products.

The integer kernels of processors with VNNI need input channels in fours and output channels in sixteens, and are 2 to 4
times slower otherwise. So channels of zeros are added to pictures and filters, and cut off again for layers that don't
run in 8 bits.

If a layer's input joins the outputs of others after ReLUs, each part has a grid of its own. Its codes are joined as
they are, and filters are scaled by the ratio of the grids. One part may have negative values. It is joined twice, as it
is and negated, each time on a grid that begins at zero.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import onnx
from onnx import helper, numpy_helper

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from numpy.typing import NDArray

INPUTS, OUTPUTS = 4, 16
"""The integer kernels are made for multiples of these numbers of channels."""
LARGEST = 1 << 30
"""Largest code of a bias: half of the 32-bit range, so that the sum of products fits too."""
FAINTEST = 1e-8
"""Smallest scale of a filter, because a filter of zeros would produce denormals."""
ACTIVATIONS = ("LeakyRelu", "Relu")
"""Element-wise functions that run in 8 bits after a convolution."""


class Grid(NamedTuple):
    """The 256 values that a tensor may take: `scale * (code - zero)`, code 0 to 255."""

    scale: np.float32
    zero: np.uint8

    @classmethod
    def over(cls, low: float, high: float) -> Grid:
        """Makes the grid over `[low, high]`, widened to hold zero, which is exactly on it because padding is zeros."""
        low, high = min(low, 0.0), max(high, 0.0)
        scale = np.float32(max(high - low, 1e-6) / 255)
        return cls(scale, np.uint8(np.clip(np.rint(-low / scale), 0, 255)))

    def round(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Rounds each value to the nearest one of the grid."""
        zero = np.float32(self.zero)
        rounded: NDArray[np.float32] = (np.clip(np.rint(values / self.scale) + zero, 0, 255) - zero) * self.scale
        return rounded


class Layer(NamedTuple):
    """A convolution that can run in 8 bits, with the function after it."""

    convolution: onnx.NodeProto
    activation: onnx.NodeProto | None
    parts: Mapping[str, int] = {}
    """The tensors that a Concat joins to form the input, with their numbers of channels: outputs of layers after ReLUs,
    and at most one other tensor. Empty if others are joined, or if the input or that tensor is read elsewhere too."""

    @property
    def name(self) -> str:
        """The name of its weights, as in the network, such as `body.2.weight`."""
        return str(self.convolution.input[1])

    @property
    def tensors(self) -> tuple[str, ...]:
        """The tensors that need a grid: the input, the output, and the convolution's output if it isn't folded."""
        sources, made = self.parts or (self.convolution.input[0],), self.convolution.output[0]
        if self.activation is None:
            return *sources, made
        # Relu needs none before it, because its own grid has nothing below zero.
        return (*sources, self.output) if self.activation.op_type == "Relu" else (*sources, made, self.output)

    @property
    def output(self) -> str:
        """The output tensor."""
        return str((self.activation or self.convolution).output[0])


def find_layers(model: onnx.ModelProto) -> list[Layer]:
    """Finds the convolutions with constant weights that are not grouped, in order.

    The one that outputs the picture is excluded: the picture must not be rounded to 256 levels.
    """
    pictures = {value.name for value in model.graph.output}
    constants = {value.name: value.dims for value in model.graph.initializer}
    readers: dict[str, list[onnx.NodeProto]] = {}
    for node in model.graph.node:
        for name in node.input:
            readers.setdefault(name, []).append(node)
    joins = {
        node.output[0]: list(node.input)
        for node in model.graph.node
        if node.op_type == "Concat" and node.attribute[0].i == 1 and len(readers.get(node.output[0], [])) == 1
    }
    found: list[Layer] = []
    channels: dict[str, int] = {}  # of the outputs of layers; 0 if they are not after a ReLU
    for node in model.graph.node:
        groups = next((a.i for a in node.attribute if a.name == "group"), 1)
        if node.op_type == "Conv" and groups == 1 and node.input[1] in constants and node.output[0] not in pictures:
            after = readers.get(node.output[0], [])
            activation = after[0] if len(after) == 1 and after[0].op_type in ACTIVATIONS else None
            parts = _count_channels(joins.get(node.input[0], []), channels, constants[node.input[1]][1])
            if any(len(readers[part]) > 1 for part in parts if part not in channels):
                parts = {}
            found.append(Layer(node, activation, parts))
            is_behind_relu = activation is not None and activation.op_type == "Relu"
            channels[found[-1].output] = constants[node.input[1]][0] if is_behind_relu else 0
    return found


def _count_channels(parts: Sequence[str], channels: Mapping[str, int], total: int) -> dict[str, int]:
    """Counts the channels of each of `parts`, `total` in all. `channels` holds those of layers. The result is empty in
    the cases that `Layer.parts` names.
    """
    known = {part: channels[part] for part in parts if part in channels}
    others, rest = len(parts) - len(known), total - sum(known.values())
    if not known or not all(known.values()) or others > 1 or others != bool(rest):
        return {}
    return {part: known.get(part, rest) for part in parts}


def insert_qdq(model: onnx.ModelProto, grids: Mapping[str, Grid], kept: Collection[str] = ()) -> onnx.ModelProto:
    """Returns a copy of a float network in which all layers of `find_layers` except those in `kept` run in 8 bits.

    `grids`: one for each of their `tensors`.
    """
    return _GraphRewriter(model, grids, kept).build()


class _GraphRewriter:
    """Builds the nodes and constants of the new graph, in order."""

    def __init__(self, model: onnx.ModelProto, grids: Mapping[str, Grid], kept: Collection[str]) -> None:
        self.model, self.grids = model, grids
        self.weights = {value.name: value for value in model.graph.initializer}
        self.makers = {output: node for node in model.graph.node for output in node.output}
        chosen = [layer for layer in find_layers(model) if layer.name not in kept]
        self.convolutions = {layer.convolution.output[0]: layer for layer in chosen}
        self.activations = {layer.activation.output[0] for layer in chosen if layer.activation is not None}
        self.read_as: dict[str, str] = {}
        """Tensor -> its values after a QDQ pair."""
        self.codes: dict[str, str] = {}
        """Tensor -> its codes."""
        self.whole: dict[str, tuple[str, int]] = {}
        """Tensor -> its codes including the channels of zeros that a layer added, and the number of these."""
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def build(self) -> onnx.ModelProto:
        for node in self.model.graph.node:
            made = node.output[0]
            if made in self.read_as:
                continue
            if made in self.convolutions:
                self.add_convolution(self.convolutions[made])
                continue
            self.nodes.append(self.copy_node(node, [self.read_as.get(name, name) for name in node.input]))
            if made in self.activations:
                self.add_pair(made)
        rewritten = onnx.ModelProto()
        rewritten.CopyFrom(self.model)
        del rewritten.graph.node[:], rewritten.graph.initializer[:]
        used = {output.name for output in self.model.graph.output}
        kept = []
        for node in reversed(self.nodes):  # onnxruntime would also run nodes that nothing reads
            if used.intersection(node.output):
                kept.append(node)
                used.update(node.input)
        rewritten.graph.node.extend(reversed(kept))
        rewritten.graph.initializer.extend(value for name, value in self.weights.items() if name in used)
        rewritten.graph.initializer.extend(value for value in self.constants if value.name in used)
        return rewritten

    def add_convolution(self, layer: Layer) -> None:
        node = layer.convolution
        made = node.output[0]
        weight = numpy_helper.to_array(self.weights[node.input[1]])
        bias = numpy_helper.to_array(self.weights[node.input[2]]) if len(node.input) > 2 else np.zeros(len(weight))
        source, grid, weight = self.add_join(layer, weight) if layer.parts else self.add_input(node.input[0], weight)
        outputs = len(weight)
        more_outputs = -outputs % OUTPUTS
        weight = np.pad(weight, ((0, more_outputs), (0, 0), (0, 0), (0, 0)))
        bias = np.pad(bias, (0, more_outputs))
        scales = np.abs(weight).max(axis=(1, 2, 3)).astype(np.float32) / 127
        # The bias must fit 32 bits even if the filter is almost zero.
        least = np.maximum(np.abs(bias) / (grid.scale * LARGEST), FAINTEST)
        scales = np.maximum(scales, least).astype(np.float32)
        products = scales * grid.scale
        codes = np.rint(weight / scales[:, None, None, None]).astype(np.int8)
        parts = [
            source,
            self.add_dequantised(f"{layer.name}_8", codes, scales),
            self.add_dequantised(f"{layer.name}_bias", np.rint(bias / products).astype(np.int32), products),
        ]
        self.nodes.append(self.copy_node(node, parts))
        relu = layer.activation is not None and layer.activation.op_type == "Relu"
        if not relu or more_outputs:
            self.add_pair(made, keep=outputs if more_outputs else 0, grid=self.grids[layer.output if relu else made])
        if relu and more_outputs:
            # A Relu's grid begins at zero, so values below zero are already zero after rounding.
            self.codes[layer.output], self.read_as[layer.output] = self.codes[made], self.read_as[made]
            self.whole[layer.output] = self.whole[made]

    def add_input(self, name: str, weight: NDArray[np.float32]) -> tuple[str, Grid, NDArray[np.float32]]:
        """Returns tensor `name` as a layer's input, its grid, and the layer's filters, both with channels of zeros."""
        grid, wide = self.grids[name], f"{name}_wide"
        codes, more = self.whole.get(name, ("", -weight.shape[1] % INPUTS))
        if not more:
            return self.add_pair(name), grid, weight
        if wide not in self.read_as:  # two convolutions may read it
            self.add_read(wide, codes or self.add_joined(name, grid, more), grid)
        return self.read_as[wide], grid, np.pad(weight, ((0, 0), (0, more), (0, 0), (0, 0)))

    def add_join(self, layer: Layer, weight: NDArray[np.float32]) -> tuple[str, Grid, NDArray[np.float32]]:
        """Does the same as `add_input` for an input that is joined from parts."""
        codes, filters = [], []
        grid = Grid(self.grids[next(iter(layer.parts))].scale, np.uint8(0))
        ends = np.cumsum(list(layer.parts.values()))[:-1]
        for part, some in zip(layer.parts, np.split(weight, ends, axis=1), strict=True):
            scale, zero = self.grids[part]
            if zero == 0:
                codes.append(self.add_codes(part, self.grids[part]))
                filters.append(some * (scale / grid.scale))
                continue
            half = Grid(np.float32(scale * max(zero, 255 - zero) / 255), np.uint8(0))
            for sign, source in ((1, part), (-1, self.add_node("Neg", [part], f"{part}_negated"))):
                codes.append(self.add_codes(source, half))
                filters.append(sign * some * (half.scale / grid.scale))
        weight = np.concatenate(filters, axis=1)
        more = -weight.shape[1] % INPUTS
        if more:
            codes[-1] = self.add_channels(codes[-1], more, grid, f"{layer.name}_input")  # others may widen it too
        joined = self.add_node("Concat", codes, f"{layer.name}_input_codes", axis=1)
        source = self.add_read(f"{layer.name}_input", joined, grid)
        return source, grid, np.pad(weight, ((0, 0), (0, more), (0, 0), (0, 0)))

    def add_pair(self, name: str, *, keep: int = 0, grid: Grid | None = None) -> str:
        """Returns the tensor after rounding to its grid, with only the first `keep` channels if that isn't 0."""
        if name not in self.read_as:
            grid = grid or self.grids[name]
            codes = self.add_codes(name, grid)
            if keep:
                self.whole[name] = codes, -keep % OUTPUTS
                ends = (("from", 0), ("to", keep), ("axis", 1))
                where = [self.add_constant(f"{name}_{key}", np.array([value])) for key, value in ends]
                codes = self.add_node("Slice", [codes, *where], f"{name}_kept")
            self.add_read(name, codes, grid)
        return self.read_as[name]

    def add_codes(self, name: str, grid: Grid, more: int = 0) -> str:
        """Returns the codes of a tensor on a grid, reusing existing ones, with `more` channels of zeros."""
        if name not in self.codes:
            self.codes[name] = self.add_rounded(name, grid, name)
        return self.add_channels(self.codes[name], more, grid) if more else self.codes[name]

    def add_joined(self, name: str, grid: Grid, more: int) -> str:
        """Does the same as `add_codes`, but rounds and widens the inputs of a Concat before it, so that only a quarter
        of the bytes is joined.
        """
        maker = self.makers.get(name)
        if name in self.codes or maker is None or maker.op_type != "Concat" or maker.attribute[0].i != 1:
            return self.add_codes(name, grid, more)
        parts = [self.add_rounded(part, grid, f"{name}_{number}") for number, part in enumerate(maker.input)]
        parts[-1] = self.add_channels(parts[-1], more, grid)
        return self.add_node("Concat", parts, f"{name}_codes", axis=1)

    def add_rounded(self, name: str, grid: Grid, label: str) -> str:
        """Returns the codes of a tensor on a grid, named after `label`."""
        constants = [self.add_constant(f"{label}_{key}", value) for key, value in grid._asdict().items()]
        return self.add_node("QuantizeLinear", [self.read_as.get(name, name), *constants], f"{label}_codes")

    def add_channels(self, codes: str, count: int, grid: Grid, label: str = "") -> str:
        """Adds `count` channels of zeros to `codes`. The result is named after `label`, or after `codes`."""
        label = label or codes
        pads = self.add_constant(f"{label}_pads", np.array([0, 0, 0, 0, 0, count, 0, 0], np.int64))
        zero = self.add_constant(f"{label}_padding", grid.zero)
        return self.add_node("Pad", [codes, pads, zero], f"{label}_wide")

    def add_read(self, name: str, codes: str, grid: Grid) -> str:
        """Returns the values of `codes` on a grid, which replace tensor `name` from here on."""
        parts = [self.add_constant(f"{name}_read_{key}", value) for key, value in grid._asdict().items()]
        self.codes[name] = codes
        self.read_as[name] = self.add_node("DequantizeLinear", [codes, *parts], f"{name}_read")
        return self.read_as[name]

    def add_dequantised(self, name: str, codes: NDArray[np.generic], scales: NDArray[np.float32]) -> str:
        """Adds a constant of symmetric codes with one scale for each output channel."""
        inputs = [self.add_constant(f"{name}_codes", codes), self.add_constant(f"{name}_scales", scales)]
        return self.add_node("DequantizeLinear", inputs, name, axis=0)

    def add_constant(self, name: str, value: NDArray[np.generic] | np.generic) -> str:
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add_node(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        self.nodes.append(helper.make_node(kind, inputs, [output], name=output, **attributes))
        return output

    @staticmethod
    def copy_node(node: onnx.NodeProto, inputs: list[str]) -> onnx.NodeProto:
        copy = onnx.NodeProto()
        copy.CopyFrom(node)
        copy.input[:] = inputs
        return copy
