"""Import of ONNX files: networks that others trained and exported, checked, measured and given a card."""

from __future__ import annotations

import hashlib
import math
from typing import TYPE_CHECKING

import onnx
import torch
from google.protobuf.message import DecodeError  # type: ignore[import-untyped]

from ciir.cores import count_available_cores
from ciir.models import cards
from ciir.models.cards import Sizes
from ciir.models.sessions import open_session
from ciir.training.export import export, measure
from ciir.training.export.export import FAILURES
from ciir.training.recipe import choose_name

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from torch import Tensor

MULTIPLES = (1, 2, 4, 8, 16, 32, 64)
"""The numbers that are tried as multiples of the sides of pictures."""
FAR_OFF = 0.25
"""Largest difference between the mean of a network's output for noise and the mean of the noise."""


class OnnxFile:
    """A network from a file, called like torch's: RGB in [0, 1], `(N, 3, H, W)` -> `(N, 3, scale*H, scale*W)`."""

    def __init__(self, path: Path) -> None:
        """Raises `ValueError` if the file holds no such network, or sides are fixed."""
        self.model = _read_model(path)
        self.weights = self.model.SerializeToString()
        try:
            self._session = open_session(self.weights, count_available_cores())
        except FAILURES as error:
            raise ValueError(f"{path}: onnxruntime can't open it ({_first_line(error)}); export it again") from error
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        self.input, self.output = inputs[0], outputs[0]
        shape = self.input.shape
        if len(shape) == 4 and shape[3] == 3:
            raise ValueError(f"{path}: takes {shape}, channels last; export it for RGB pictures (N, 3, H, W)")
        if len(shape) == 4 and isinstance(shape[0], int) and shape[0] != 1:
            raise ValueError(
                f"{path}: takes only {shape[0]} pictures at a time; export it with a free batch, or a batch of 1"
            )
        if len(inputs) > 1 or self.input.type != "tensor(float)" or len(shape) != 4 or shape[1] in (1, 2, 4):
            taken = ", ".join(f"{each.name} {each.type} {each.shape}" for each in inputs)
            raise ValueError(f"{path}: takes {taken}; give a network of RGB pictures in float32, (N, 3, H, W)")
        if any(isinstance(side, int) for side in shape[2:]):
            raise ValueError(
                f"{path}: takes only pictures of {shape[2]}x{shape[3]} pixels; export it with free height and width, "
                "for example with dynamic_axes or dynamic_shapes of torch.onnx.export"
            )

    def __call__(self, images: Tensor) -> Tensor:
        """See the class."""
        return torch.from_numpy(self._session.run([self.output.name], {self.input.name: images.numpy()})[0])

    def can_run(self, count: int, height: int, width: int) -> tuple[int, ...]:
        """Returns the output's shape for `count` pictures of this size; empty if the network fails."""
        try:
            return tuple(self(torch.full((count, 3, height, width), 0.5)).shape)
        except FAILURES:
            return ()


def export_onnx(
    path: Path, out: Path, *, name: str = "", accuracy_on: Sequence[Path] = (), degradation: str = ""
) -> Path:
    """Writes `NAME.onnx`, with all weights in it, and `NAME.json` into `out` and returns the card's path. NAME is the
    file's stem if not given. `accuracy_on`, `degradation`: as for `export.export_network`.

    Raises `ValueError` if the file holds no network that upscales RGB in [0, 1] of any size, or tiles can't be used.
    """
    name = choose_name(name, path.stem)
    network = OnnxFile(path)
    sizes, scale = _find_sizes(network, path)
    _check_range(network, sizes, path)
    batch = "batch" if _takes_several(network, sizes) else 1
    opset = max(each.version for each in network.model.opset_import if each.domain in ("", "ai.onnx"))
    card = cards.Card(
        name=name,
        kind="a network of an ONNX file, trained by others",
        scale=scale,
        sha256="0" * 64,
        opset=opset,
        input=cards.Tensor(network.input.name, (batch, 3, "height", "width"), "float32", 0.0, 1.0),
        output=cards.Tensor(network.output.name, (batch, 3, f"{scale}*height", f"{scale}*width"), "float32", 0.0, 1.0),
        radius=measure.find_tile_overlap(network, scale, sizes),
        parameters=max(1, sum(math.prod(each.dims) for each in network.model.graph.initializer)),
        macs_per_output_pixel=_count_macs(network, scale, sizes),
        training=cards.Training({"onnx": path.name, "sha256": _hash(path)}, "unknown", 0, 0),
        protocol="",
        command="",
        accuracy=(),
        sizes=sizes,
    )
    return export.write_network(network.weights, card, out, accuracy_on=accuracy_on, degradation=degradation)


def _read_model(path: Path) -> onnx.ModelProto:
    """Reads the model with its weights, including those in other files of the same folder."""
    try:
        return onnx.load(path)
    except DecodeError as error:
        raise ValueError(f"{path}: not an ONNX file; give one written by torch.onnx.export") from error
    except (FileNotFoundError, onnx.checker.ValidationError) as error:  # weights in another file
        raise ValueError(
            f"{path}: its weights can't be read ({_first_line(error)}); put their file next to it"
        ) from error


def _find_sizes(network: OnnxFile, path: Path) -> tuple[Sizes, int]:
    """Finds the number that the sides of pictures must be multiples of, and the scale."""
    for multiple in MULTIPLES:
        sizes = Sizes(max(Sizes().minimum, multiple), multiple)
        rows, cols = sizes.round_up(17, 29)
        made = network.can_run(1, rows, cols)
        if len(made) == 4 and made[1] == 3 and made[2] % rows == 0 and made[2:] == (made[2], made[2] // rows * cols):
            scale = made[2] // rows
            if scale < 2:
                raise ValueError(f"{path}: doesn't upscale; give a network that does, by 2 or more")
            return sizes, scale
    raise ValueError(
        f"{path}: makes no RGB picture of at least twice the size from 17x29 pixels, nor if its sides are rounded up "
        f"to multiples of up to {MULTIPLES[-1]}; give a network that upscales RGB, (N, 3, H, W)"
    )


def _check_range(network: OnnxFile, sizes: Sizes, path: Path) -> None:
    """Raises `ValueError` if the output for noise in [0, 1] is far from that range."""
    noise = torch.rand((1, 3, *sizes.round_up(32, 32)), generator=torch.Generator().manual_seed(0))
    mean = float(network(noise).mean())
    if not abs(mean - 0.5) <= FAR_OFF:
        raise ValueError(
            f"{path}: makes a picture with a mean of {mean:.3g} from one with a mean of 0.5; give a network that takes "
            "and makes RGB in [0, 1]"
        )


def _takes_several(network: OnnxFile, sizes: Sizes) -> bool:
    """Returns whether the output for two pictures at once equals the outputs for each."""
    pair = torch.rand((2, 3, *sizes.round_up(17, 29)), generator=torch.Generator().manual_seed(0))
    alone = torch.cat([network(pair[:1]), network(pair[1:])])
    try:
        together = network(pair)
    except FAILURES:
        return False
    return together.shape == alone.shape and torch.allclose(together, alone, atol=export.TOLERANCE)


def _count_macs(network: OnnxFile, scale: int, sizes: Sizes) -> float:
    """Counts the multiply-adds of convolutions and matrix products for one output pixel, like `measure.count_macs`.
    Those for which ONNX can't infer shapes count as 0.
    """
    rows, cols = sizes.round_up(measure.SMALL, measure.SMALL)
    model = onnx.ModelProto()
    model.CopyFrom(network.model)
    (picture,) = (each for each in model.graph.input if each.name == network.input.name)
    for side, size in zip(picture.type.tensor_type.shape.dim, (1, 3, rows, cols), strict=True):
        side.dim_value = size
    graph = onnx.shape_inference.infer_shapes(model).graph
    shapes = {each.name: tuple(each.dims) for each in graph.initializer}
    for each in (*graph.input, *graph.value_info, *graph.output):
        shapes.setdefault(each.name, tuple(side.dim_value for side in each.type.tensor_type.shape.dim))
    total = 0
    for node in graph.node:
        made = math.prod(shapes.get(node.output[0], (0,)))
        if node.op_type == "Conv":
            total += made * math.prod(shapes.get(node.input[1], (0, 0))[1:])
        elif node.op_type == "ConvTranspose":
            taken = math.prod(shapes.get(node.input[0], (0,)))
            total += taken * math.prod(shapes.get(node.input[1], (0, 0))[1:])
        elif node.op_type in ("MatMul", "Gemm"):
            total += made * shapes.get(node.input[0], (0,))[-1]
    return total / (rows * cols * scale**2)


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0][:200]
