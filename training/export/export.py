"""Export of a checkpoint to the files of `models`: an `.onnx` file and its card."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import shlex
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from onnxruntime.capi import onnxruntime_pybind11_state as runtime

from ciir.cores import count_available_cores
from ciir.models import cards
from ciir.models.cards import Sizes
from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.sessions import open_session
from ciir.models.single.network import SingleImageNetwork
from ciir.training.data.downscale import KINDS
from ciir.training.evaluation import light_fields, pictures
from ciir.training.export import inputs as examples
from ciir.training.export import measure, to_onnx
from ciir.training.loop import checkpoints
from ciir.training.loop.run import as_tuple
from ciir.training.networks import make_network
from ciir.training.networks.batch_norm import fold_batch_norm
from ciir.training.networks.collapsible import collapse
from ciir.training.networks.interpolation import separate
from ciir.training.networks.light_field import LightFieldGenerator, WithUncertainty, fold_factors, merge_layers
from ciir.training.recipe import choose_name, shorten_paths

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torch import nn

TOLERANCE = 1e-4
"""Largest absolute difference between torch and onnxruntime that is accepted."""
SMALLEST = 1e-12
"""Weights closer to zero become zero. They change no 16-bit output, but they or products of two of them may be denormal
(under 1.2e-38), and a CPU multiplies denormals up to 100 times slower."""
SHAPES = ((1, 3, 1, 1), (1, 3, 7, 5), (2, 3, 25, 25), (1, 3, 97, 131), (3, 3, 1, 40))
"""Shapes at which the two are compared: `(N, C, H, W)`, enlarged to the sizes that the network takes."""
FAILURES = (
    runtime.Fail,
    runtime.InvalidArgument,
    runtime.InvalidGraph,
    runtime.InvalidProtobuf,
    runtime.NotImplemented,
    runtime.RuntimeException,
)
"""The errors that onnxruntime raises for networks that it can't open or run."""
INT8 = "-int8"
"""The suffix of the name of an int8 twin."""


def export_network(
    checkpoint: Path, out: Path, *, name: str = "", accuracy_on: Sequence[Path] = (), degradation: str = ""
) -> Path:
    """Writes `NAME.onnx` and `NAME.json` into `out` and returns the card's path. NAME is `name` or the recipe's name.

    `checkpoint`: from `training.loop.train.train`. `accuracy_on`: folders of `*_LR.png` and `*_HR.png` pairs, or of
    views for a light-field network. Their scores (`training.evaluation.pictures`, `training.evaluation.light_fields`)
    go on the card. `degradation`: one of `KINDS` by which LR is made; if empty, LR pictures are those of the pairs, and
    views are degraded in each way of `KINDS`.

    Raises `ValueError` if the exported network differs from torch by more than `TOLERANCE`.
    """
    weights, card = convert_checkpoint(checkpoint, name)
    return write_network(weights, card, out, accuracy_on=accuracy_on, degradation=degradation)


def export_int8(
    checkpoint: Path,
    out: Path,
    *,
    calibrate: Sequence[Path],
    name: str = "",
    accuracy_on: Sequence[Path] = (),
    degradation: str = "",
) -> Path:
    """Exports the network's int8 twin, `NAME-int8`, like `export_network`. `calibrate`: folders of pictures, see
    `training.export.calibration`.

    Raises `ValueError` as `export_network` does, and if the pictures can't be used or int8 costs too much accuracy.
    """
    from ciir.training.export import calibration, quantise

    weights, card = convert_checkpoint(checkpoint, name)
    if card.is_light_field:
        pairs = calibration.make_light_field_examples(calibrate, card.scale, card.planes)
    else:
        pairs = calibration.make_picture_examples(calibrate, card.scale)
    weights, kept = quantise.quantise_network(weights, pairs)
    how = {"calibrate": [folder.resolve().name for folder in calibrate], "float_layers": kept}
    twin = dataclasses.replace(
        card,
        name=card.name + INT8,
        precision="int8",
        float_twin=card.name,
        training=dataclasses.replace(card.training, recipe=card.training.recipe | {"int8": how}),
    )
    return write_network(weights, twin, out, accuracy_on=accuracy_on, degradation=degradation)


def convert_checkpoint(checkpoint: Path, name: str = "") -> tuple[bytes, cards.Card]:
    """Converts a checkpoint's network to float ONNX and makes its card, without the values that `write_network` fills
    in.

    `name`: used instead of the recipe's. Raises the same errors as `export_network`.
    """
    state = checkpoints.read_checkpoint(checkpoint)
    recipe = state["recipe"]
    name = choose_name(name, str(recipe["name"]))
    trained = load_network(state)
    network = simplify_network(trained)
    sizes = Sizes()
    weights = to_onnx.convert_network(network, int(recipe["scale"]))
    compare_with_torch(network, weights)
    radius = measure.find_receptive_radius(network, int(recipe["scale"]))
    card = make_card(
        network,
        name=name,
        kind=_first_line(sys.modules[type(trained).__module__].__doc__) + _losses(recipe),
        scale=int(recipe["scale"]),
        radius=measure.find_tile_overlap(network, int(recipe["scale"]), sizes) if radius is None else radius,
        sizes=sizes,
        training=cards.Training(shorten_paths(recipe), state["commit"], state["step"], recipe["seed"]),
        runs=int(recipe.get("runs", 1)),  # older checkpoints have no runs
    )
    return weights, card


def make_card(
    network: nn.Module,
    *,
    name: str,
    kind: str,
    scale: int,
    radius: int,
    sizes: Sizes,
    training: cards.Training,
    runs: int = 1,
) -> cards.Card:
    """Makes the card of a float network with a hash of zeros and without accuracy."""
    inputs = examples.list_inputs(network)
    return cards.Card(
        name=name,
        kind=kind,
        scale=scale,
        sha256="0" * 64,
        opset=to_onnx.OPSET,
        input=inputs[0],
        output=to_onnx.output(scale),
        radius=radius,
        parameters=measure.count_parameters(network),
        macs_per_output_pixel=runs * measure.count_macs(network, sizes),
        training=training,
        protocol="",
        command="",
        accuracy=(),
        runs=runs,
        sizes=sizes,
        extra_inputs=inputs[1:],
        extra_outputs=examples.list_outputs(network),
    )


def write_network(
    weights: bytes, card: cards.Card, out: Path, *, accuracy_on: Sequence[Path] = (), degradation: str = ""
) -> Path:
    """Writes a network and its card, with hash and accuracy, into `out`. If there is an error, neither is written.
    `accuracy_on`, `degradation`: as for `export_network`.

    Raises `ValueError` if a folder of `accuracy_on` can't be scored on, or this processor can't run the network.
    """
    card = dataclasses.replace(card, sha256=hashlib.sha256(weights).hexdigest())
    if accuracy_on:
        protocol = pictures.describe_protocol(accuracy_on, degradation)
        card = dataclasses.replace(
            card,
            protocol=light_fields.PROTOCOL if card.is_light_field else protocol,
            command=_command(card, accuracy_on, degradation),
        )
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out) as folder:
        path = Path(folder) / f"{card.name}.json"
        network_path = path.with_suffix(".onnx")
        network_path.write_bytes(weights)
        cards.write_card(card, path)
        if accuracy_on:
            cards.write_card(dataclasses.replace(card, accuracy=_scores(path, accuracy_on, degradation)), path)
        network_path.replace(out / network_path.name)
        return path.replace(out / path.name)


def _command(card: cards.Card, folders: Sequence[Path], degradation: str) -> str:
    """Returns the commands that print the scores of `_scores`, in order. Of absolute paths only the names are shown,
    because cards are published.
    """
    names = [shlex.quote(folder.name if folder.is_absolute() else folder.as_posix()) for folder in folders]
    if not card.is_light_field:
        words = [f"--degradation {degradation}"] if degradation else []
        words += [f"--scale {card.scale}"] if card.scale != 2 else []
        return " ".join(["ciir evaluate", card.name, *names, *words])
    tries = itertools.product(names, [degradation] if degradation else KINDS)
    return "; ".join(f"ciir evaluate {card.name} --light-field {name} --degradation {kind}" for name, kind in tries)


def _scores(path: Path, folders: Sequence[Path], degradation: str) -> tuple[cards.Accuracy, ...]:
    """Scores a network on each folder; a light-field network with `degradation`, or with each of `KINDS`."""
    if not cards.read_card(path).is_light_field:
        upscaler = SingleImageNetwork(path, emulates_int8=True)
        return tuple(pictures.score(upscaler, folder, degradation=degradation) for folder in folders)
    network = LightFieldNetwork(path, emulates_int8=True)
    tries = itertools.product(folders, [degradation] if degradation else KINDS)
    return tuple(light_fields.measure(network, folder, degradation=kind).mean for folder, kind in tries)


def load_network(state: dict[str, Any]) -> nn.Module:
    """Loads the network of a checkpoint in evaluation mode, as it was trained."""
    recipe = state["recipe"]
    network = make_network(recipe["network"], recipe["options"])
    network.load_state_dict(state["network"])
    return network.eval()


@torch.no_grad()
def simplify_network(network: nn.Module) -> nn.Module:
    """Folds branches, factors and batch normalisation, merges added convolutions of a light-field network, separates
    interpolation, and sets weights closer to zero than `SMALLEST` to zero.
    """
    network = separate(collapse(fold_batch_norm(network)))
    if isinstance(network, LightFieldGenerator):
        fold_factors(network)
        merge_layers(network)
    for weight in (*network.parameters(), *network.buffers()):
        weight[weight.abs() < SMALLEST] = 0.0
    return network.eval()


@torch.no_grad()
def compare_with_torch(network: nn.Module, weights: bytes, sizes: Sizes = Sizes(minimum=1)) -> float:  # noqa: B008 - is frozen
    """Returns the largest difference between torch and onnxruntime over `SHAPES` and all windows, on noise in [0, 1].

    Raises `ValueError` if it is more than `TOLERANCE`, or either fails at one of them.
    """
    session = open_session(weights, threads=count_available_cores())
    names = [tensor.name for tensor in examples.list_inputs(network)]
    whole = WithUncertainty(network) if isinstance(network, LightFieldGenerator) else network
    largest = 0.0
    for place, (count, channels, height, width) in itertools.product(examples.list_windows(network), SHAPES):
        shape = (count, channels, *sizes.round_up(height, width))
        inputs = examples.make_examples(network, count, *shape[2:], place=place)
        try:
            made = session.run(None, {name: part.numpy() for name, part in zip(names, inputs, strict=True)})
            wished = [part.numpy() for part in as_tuple(whole(*inputs))]
        except (RuntimeError, *FAILURES) as error:  # torch's, and onnxruntime's
            reason = str(error).strip().partition("\n")[0]
            raise ValueError(f"the network can't be used at {shape}: its sizes aren't free ({reason})") from error
        for got, wanted in zip(made, wished, strict=True):
            if got.shape != wanted.shape:
                raise ValueError(f"onnxruntime makes {got.shape} from {shape}, but torch makes {wanted.shape}")
            difference = float(np.abs(got - wanted).max())
            if not difference <= TOLERANCE:
                raise ValueError(
                    f"onnxruntime differs from torch by {difference} at {shape}; at most {TOLERANCE} is allowed"
                )
            largest = max(largest, difference)
    return largest


def _losses(recipe: dict[str, Any]) -> str:
    """Names the losses of a network that was not trained on pixels only, because PSNR then describes it badly."""
    if not recipe.get("adversarial"):
        return ""
    content = recipe.get("perceptual") or "none"
    return f"; adversarial ({recipe['adversarial']}; perceptual term: {content}), for the eye"


def _first_line(text: str | None) -> str:
    return (text or "").strip().splitlines()[0].rstrip(".")
