"""A shipped network in torch: its ONNX graph, node by node, each as the ONNX operators' page defines it (opset 20).

The reference that onnxruntime is held against, and, as torch differentiates it, what gradient searches climb. It knows
the operators that shipped networks hold and raises `ValueError` for others. int8 graphs are computed as they are
written: in float, rounded to each tensor's grid.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

    Inputs = list[Tensor]
    Attributes = dict[str, Any]


def missing() -> str:
    """What is not installed that this needs, with the remedy; empty where all is there."""
    from importlib.util import find_spec

    absent = [name for name in ("torch", "onnx") if find_spec(name) is None]
    return f"needs {' and '.join(absent)}: pip install 'ciir[training]'" if absent else ""


def network(weights: bytes) -> Callable[[Tensor], Tensor]:
    """The serialised ONNX `weights` as a function `(N, 3, H, W)` -> `(N, 3, scale*H, scale*W)` that torch can follow.

    Raises `ValueError` where an operator, or a way of using it, is not known.
    """
    import onnx
    import torch
    from onnx import helper, numpy_helper

    graph = onnx.load_from_string(weights).graph
    constants = {value.name: torch.from_numpy(numpy_helper.to_array(value).copy()) for value in graph.initializer}
    steps = [
        (node, _operator(node.op_type), {part.name: helper.get_attribute_value(part) for part in node.attribute})
        for node in graph.node
    ]

    def run(images: Tensor) -> Tensor:
        known: dict[str, Tensor] = {**constants, graph.input[0].name: images}
        for node, operator, attributes in steps:
            known[node.output[0]] = operator([known[name] for name in node.input if name], attributes)
        return known[graph.output[0].name]

    return run


def _operator(kind: str) -> Callable[[Inputs, Attributes], Tensor]:
    if kind not in _OPERATORS:
        raise ValueError(f"operator {kind}: not known in torch; it knows {', '.join(_OPERATORS)}; add it there")
    return _OPERATORS[kind]


def _check(given: object, expected: object, what: str) -> None:
    if given != expected:
        raise ValueError(f"{what} {given!r}: only {expected!r} is known in torch; add it there")


def _conv(inputs: Inputs, attributes: Attributes) -> Tensor:
    from torch.nn import functional

    image, weight, *bias = inputs
    top, left, bottom, right = attributes["pads"]
    _check(attributes["dilations"], [1, 1], "Conv: dilations")
    own = (top, left)
    if own != (bottom, right):  # torch's own padding is quicker, and the same at both ends
        image, own = functional.pad(image, (left, right, top, bottom)), (0, 0)
    stride, groups = attributes["strides"], attributes["group"]
    return functional.conv2d(image, weight, bias[0] if bias else None, stride, own, groups=groups)


def _conv_transpose(inputs: Inputs, attributes: Attributes) -> Tensor:
    from torch.nn import functional

    top, left, bottom, right = attributes["pads"]
    _check([bottom, right], [top, left], "ConvTranspose: pads at the ends")
    _check(attributes["dilations"] + [attributes["group"]], [1, 1, 1], "ConvTranspose: dilations and groups")
    image, weight, *bias = inputs
    stride, more = attributes["strides"], attributes["output_padding"]
    return functional.conv_transpose2d(image, weight, bias[0] if bias else None, stride, (top, left), more)


def _pad(inputs: Inputs, attributes: Attributes) -> Tensor:
    from torch.nn import functional

    image, pads = inputs  # a third would be what to fill with, in place of zeros
    mode = attributes.get("mode", b"constant").decode()
    before, after = pads.reshape(2, -1).flip(1).tolist()  # torch begins with the last axis
    both = [side for pair in zip(before, after, strict=True) for side in pair]
    if mode == "constant":
        return functional.pad(image, both)
    _check(mode, "edge", "Pad: mode")
    return functional.pad(image, both[:4], mode="replicate")


def _depth_to_space(inputs: Inputs, attributes: Attributes) -> Tensor:
    from torch.nn import functional

    _check(attributes["mode"], b"CRD", "DepthToSpace: mode")
    return functional.pixel_shuffle(inputs[0], attributes["blocksize"])


def _resize(inputs: Inputs, attributes: Attributes) -> Tensor:
    """Each pixel repeated; all other ways of resizing are refused."""
    how = tuple(attributes[key] for key in ("mode", "nearest_mode", "coordinate_transformation_mode"))
    _check(how, (b"nearest", b"floor", b"asymmetric"), "Resize: mode")
    image, scales = inputs
    for axis, scale in enumerate(scales.tolist()):
        image = image.repeat_interleave(int(scale), dim=axis)
    return image


def _slice(inputs: Inputs, attributes: Attributes) -> Tensor:  # noqa: ARG001
    image, *where = inputs
    start, end, axis = (int(value.item()) for value in where)
    return image.narrow(axis, start, min(end, image.shape[axis]) - start)


def _expand(inputs: Inputs, attributes: Attributes) -> Tensor:  # noqa: ARG001
    image, shape = inputs
    missing = len(shape) - image.ndim
    filled = [1] * missing + list(image.shape)
    return image.expand([max(pair) for pair in zip(filled, shape.tolist(), strict=True)])


def _shape(inputs: Inputs, attributes: Attributes) -> Tensor:
    import torch

    return torch.tensor(inputs[0].shape[attributes.get("start", 0) :])


def _quantize(inputs: Inputs, attributes: Attributes) -> Tensor:  # noqa: ARG001
    """Codes as float numbers: `clip(round(x / scale) + zero, 0, 255)`, halves to even."""
    image, scale, zero = inputs
    return ((image / scale).round() + zero.float()).clamp(0, 255)


def _dequantize(inputs: Inputs, attributes: Attributes) -> Tensor:
    codes, scale, *zero = inputs
    if scale.ndim:
        shape = [1] * codes.ndim
        shape[attributes["axis"]] = -1
        scale = scale.reshape(shape)
    return (codes.float() - (zero[0].float() if zero else 0.0)) * scale


_OPERATORS: dict[str, Callable[[Inputs, Attributes], Tensor]] = {
    "Add": lambda inputs, _: inputs[0] + inputs[1],
    "Conv": _conv,
    "ConvTranspose": _conv_transpose,
    "DepthToSpace": _depth_to_space,
    "DequantizeLinear": _dequantize,
    "Expand": _expand,
    "LeakyRelu": lambda inputs, attributes: _leaky(inputs[0], attributes["alpha"]),
    "Pad": _pad,
    "QuantizeLinear": _quantize,
    "Relu": lambda inputs, _: inputs[0].relu(),
    "Resize": _resize,
    "Shape": _shape,
    "Slice": _slice,
}


def _leaky(image: Tensor, slope: float) -> Tensor:
    from torch.nn import functional

    return functional.leaky_relu(image, slope)
