"""A checkpoint becomes what `models` ships: one `.onnx` file and its card."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import nn

from models import card as cards
from models.session import Network, available_cores, open_session
from training import checkpoints, evaluate, to_onnx
from training.networks import make

if TYPE_CHECKING:
    from collections.abc import Sequence

TOLERANCE = 1e-4
"""Largest absolute difference between torch and onnxruntime that is let through."""
SMALLEST = 1e-12
"""Weights nearer to zero than this become zero: they change no output that 16 bits can tell, but they, and even the
products of two of them, may be denormal (under 1.2e-38), and a CPU multiplies denormals up to 100 times slower."""
SHAPES = ((1, 3, 1, 1), (1, 3, 7, 5), (2, 3, 25, 25), (1, 3, 97, 131), (3, 3, 1, 40))
"""Where the two are compared: `(N, C, H, W)`."""


def export(checkpoint: Path, out: Path, *, accuracy_on: Sequence[Path] = ()) -> Path:
    """Writes `NAME.onnx` and `NAME.json` into `out` and returns the card's path; NAME is the recipe's.

    `checkpoint`: of `training.loop.train`. `accuracy_on`: folders of `*_LR.png` and `*_HR.png` pairs, whose scores
    (`training.evaluate`) go on the card.

    Raises `ValueError` where the exported network differs from torch by more than `TOLERANCE`.
    """
    state = checkpoints.read(checkpoint)
    recipe = state["recipe"]
    name, scale = str(recipe["name"]), int(recipe["scale"])
    network = from_checkpoint(state)
    weights = to_onnx.convert(network, scale)
    compare(network, weights)

    card = cards.Card(
        name=name,
        kind=_first_line(sys.modules[type(network).__module__].__doc__),
        scale=scale,
        sha256=hashlib.sha256(weights).hexdigest(),
        opset=to_onnx.OPSET,
        input=cards.Tensor(to_onnx.INPUT, ("batch", 3, "height", "width"), "float32", 0.0, 1.0),
        output=cards.Tensor(to_onnx.OUTPUT, ("batch", 3, f"{scale}*height", f"{scale}*width"), "float32", 0.0, 1.0),
        radius=receptive_radius(network, scale),
        parameters=sum(p.numel() for p in network.parameters()),
        macs_per_output_pixel=macs_per_output_pixel(network),
        training=cards.Training(recipe, state["commit"], state["step"], recipe["seed"]),
        protocol=evaluate.PROTOCOL,
        command=" ".join(["ciir evaluate", name, *(folder.as_posix() for folder in accuracy_on)]),
        accuracy=(),
    )
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out) as folder:
        path = Path(folder) / f"{name}.json"
        network_path = path.with_suffix(".onnx")
        network_path.write_bytes(weights)
        cards.write(card, path)
        if accuracy_on:
            upscaler = Network(path)
            scores = tuple(evaluate.evaluate(upscaler, data) for data in accuracy_on)
            cards.write(dataclasses.replace(card, accuracy=scores), path)
        network_path.replace(out / network_path.name)
        return path.replace(out / path.name)


def from_checkpoint(state: dict[str, Any]) -> nn.Module:
    """The network of a checkpoint in evaluation mode, weights under `SMALLEST` set to zero."""
    recipe = state["recipe"]
    network = make(recipe["network"], recipe["options"])
    network.load_state_dict(state["network"])
    with torch.no_grad():
        for weight in network.parameters():
            weight[weight.abs() < SMALLEST] = 0.0
    return network.eval()


@torch.no_grad()
def compare(network: nn.Module, weights: bytes) -> float:
    """The largest difference between torch and onnxruntime over `SHAPES`, on noise in [0, 1].

    Raises `ValueError` where it is more than `TOLERANCE`.
    """
    session = open_session(weights, threads=available_cores())
    random = np.random.default_rng(0)
    largest = 0.0
    for shape in SHAPES:
        images = random.random(shape, dtype=np.float32)
        (got,) = session.run(None, {to_onnx.INPUT: images})
        difference = float(np.abs(got - network(torch.from_numpy(images)).numpy()).max())
        if not difference <= TOLERANCE:
            raise ValueError(f"onnxruntime differs from torch by {difference} at {shape}; {TOLERANCE} is the most")
        largest = max(largest, difference)
    return largest


def receptive_radius(network: nn.Module, scale: int) -> int:
    """How many input pixels away, along each side, an input pixel can still change an output pixel.

    Measured: the gradient of one input pixel's `scale x scale` outputs, with every weight replaced by a positive
    number, so that no path cancels or rests on the weights that training happened to find.

    Raises `ValueError` where the field is wider than the largest probe.
    """
    probe = copy.deepcopy(network).double()
    with torch.no_grad():
        for weight in probe.parameters():
            weight.fill_(0.0 if weight.ndim == 1 else 1.0 / weight[0].numel())
    for centre in (16, 32, 64, 128):
        image = torch.ones(1, 3, 2 * centre + 1, 2 * centre + 1, dtype=torch.float64, requires_grad=True)
        cell = slice(centre * scale, (centre + 1) * scale)
        (gradient,) = torch.autograd.grad(probe(image)[..., cell, cell].sum(), image)
        touched = gradient[0].abs().sum(0).nonzero()  # (touched pixels, 2)
        radius = int((touched - centre).abs().max())
        if radius < centre:
            return radius
    raise ValueError(f"the receptive field reaches over {centre} pixels; tiles would be all halo: make it shallower")


@torch.no_grad()
def macs_per_output_pixel(network: nn.Module) -> float:
    """Multiply-adds of all convolutions for one output pixel (its three channels together)."""
    counts: list[int] = []

    def count(module: nn.Module, _: object, output: torch.Tensor) -> None:
        assert isinstance(module, nn.Conv2d)  # noqa: S101 - only convolutions are hooked
        counts.append(output[0].numel() * module.weight[0].numel())

    hooks = [m.register_forward_hook(count) for m in network.modules() if isinstance(m, nn.Conv2d)]
    output = network(torch.rand(1, 3, 16, 16))
    for hook in hooks:
        hook.remove()
    return float(sum(counts) / output[0, 0].numel())


def _first_line(text: str | None) -> str:
    return (text or "").strip().splitlines()[0].rstrip(".")
