"""Conversion of a torch network to an ONNX file, without the exporter's metadata."""

from __future__ import annotations

import contextlib
import logging
import warnings
from typing import TYPE_CHECKING

import onnx
import torch

from ciir.models.cards import Sizes, Tensor
from ciir.training.export import inputs as examples
from ciir.training.networks.light_field import LightFieldGenerator, WithUncertainty

if TYPE_CHECKING:
    from collections.abc import Iterator

    from torch import nn

OPSET = 18
"""The lowest opset that torch writes. onnxruntime 1.31 averages over patches 20 times slower with opset 19 or later."""
INPUT, OUTPUT = examples.IMAGE.name, "upscaled"


def convert_network(network: nn.Module, scale: int, sizes: Sizes = Sizes()) -> bytes:  # noqa: B008 - is frozen
    """Converts a network to a serialised ONNX model with its weights; batch, height and width are free.

    `network` takes `examples.list_inputs` and returns `(N, 3, scale*H, scale*W)`, for the H and W that `sizes` allows.

    Raises `ValueError` if its sizes are fixed, or ONNX lacks one of its operations.
    """
    inputs, outputs = examples.list_inputs(network), (output(scale), *examples.list_outputs(network))
    free = [[axis for axis, size in enumerate(tensor.shape) if isinstance(size, str)] for tensor in inputs]
    try:
        with _quiet():
            program = torch.onnx.export(
                WithUncertainty(network) if isinstance(network, LightFieldGenerator) else network,
                tuple(
                    examples.make_examples(network, 2, *sizes.round_up(24, 20))
                ),  # a free axis must not be 1 in the example
                dynamo=True,
                dynamic_shapes=tuple(dict.fromkeys(axes, torch.export.Dim.DYNAMIC) for axes in free),
                input_names=[tensor.name for tensor in inputs],
                output_names=[tensor.name for tensor in outputs],
                opset_version=OPSET,
                verbose=False,
            )
    except torch.onnx.errors.OnnxExporterError as error:
        cause = str(error.__cause__ or error).strip().partition("\n")[0]
        raise ValueError(f"the network can't be exported with free batch, height and width ({cause})") from error
    assert program is not None  # noqa: S101 - None only if a file is named
    model = program.model_proto
    for value, tensor in zip(model.graph.input, inputs, strict=True):
        _name_axes(value, tensor.shape)
    for value, tensor in zip(model.graph.output, outputs, strict=True):
        _name_axes(value, tensor.shape)
    del model.graph.value_info[:]  # intermediate sizes, under the exporter's own names
    _forget_sources(model)
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def output(scale: int) -> Tensor:
    """Describes the picture that every network outputs."""
    return Tensor(OUTPUT, ("batch", 3, *(f"{scale}*{side}" for side in examples.FREE)), "float32", 0.0, 1.0)


def _name_axes(value: onnx.ValueInfoProto, shape: tuple[str | int, ...]) -> None:
    """Gives the free axes the names that they have on the card."""
    for size, name in zip(value.type.tensor_type.shape.dim, shape, strict=True):
        if isinstance(name, str):
            size.dim_param = name


def _forget_sources(model: onnx.ModelProto) -> None:
    """Removes the source locations of the nodes."""
    del model.metadata_props[:], model.graph.metadata_props[:]
    for part in (*model.graph.node, *model.graph.initializer, *model.graph.input, *model.graph.output):
        part.doc_string = ""
        del part.metadata_props[:]


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silences the exporter's advice to install torchvision, and warnings about torch's own calls."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*LeafSpec.* is deprecated", FutureWarning)
            yield
    finally:
        logger.setLevel(level)
