"""A torch network as one ONNX file, without what only its exporter needs."""

from __future__ import annotations

import contextlib
import logging
import warnings
from typing import TYPE_CHECKING

import onnx
import torch

from models.card import Sizes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from torch import nn

OPSET = 20
INPUT, OUTPUT = "image", "upscaled"


def convert(network: nn.Module, scale: int, sizes: Sizes = Sizes()) -> bytes:  # noqa: B008 - is frozen
    """The network as a serialised ONNX model, weights inside; batch, height and width are free.

    `network`: `(N, 3, H, W)` -> `(N, 3, scale*H, scale*W)`, for the H and W that `sizes` allows.

    Raises `ValueError` where the network can't be written so: its sizes are fixed, or ONNX has not what it does.
    """
    free = torch.export.Dim.DYNAMIC
    try:
        with _quiet():
            program = torch.onnx.export(
                network,
                (torch.rand(2, 3, *sizes.fitted(24, 20)),),  # a free axis must not be 1 in the example
                dynamo=True,
                dynamic_shapes=({0: free, 2: free, 3: free},),
                input_names=[INPUT],
                output_names=[OUTPUT],
                opset_version=OPSET,
                verbose=False,
            )
    except torch.onnx.errors.OnnxExporterError as error:
        cause = str(error.__cause__ or error).strip().partition("\n")[0]
        raise ValueError(f"the network can't be exported with free batch, height and width ({cause})") from error
    assert program is not None  # noqa: S101 - None only where a file is named
    model = program.model_proto
    for value, factor in ((model.graph.input[0], 1), (model.graph.output[0], scale)):
        for axis, name in ((0, "batch"), (2, "height"), (3, "width")):
            size = value.type.tensor_type.shape.dim[axis]
            size.dim_param = name if factor == 1 or name == "batch" else f"{factor}*{name}"
    del model.graph.value_info[:]  # the sizes in between, under the exporter's own names
    _forget_sources(model)
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def _forget_sources(model: onnx.ModelProto) -> None:
    """Drops the notes on where in which file each node came from."""
    del model.metadata_props[:], model.graph.metadata_props[:]
    for part in (*model.graph.node, *model.graph.initializer, *model.graph.input, *model.graph.output):
        part.doc_string = ""
        del part.metadata_props[:]


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keeps the exporter from advising to install torchvision and from warning of what torch itself calls."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*LeafSpec.* is deprecated", FutureWarning)
            yield
    finally:
        logger.setLevel(level)
