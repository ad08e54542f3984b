"""Import of external weights: networks that others trained, exported to ONNX with a card.

spandrel (chaiNNer-org) infers the architecture and its options from the names and shapes of the weights.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
import types
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import torch
from torch import Tensor, nn

from ciir.models import cards
from ciir.models.cards import Sizes
from ciir.training.export import export, measure, to_onnx
from ciir.training.loop import checkpoints
from ciir.training.recipe import choose_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

SUFFIXES = (".pth", ".pt", ".ckpt", ".safetensors")
UNUSED = ("InterpolationMode", "normalize", "rotate")
"""Names that spandrel imports from `torchvision.transforms.functional`, for LaMa (inpainting) and RestoreFormer
(faces)."""


class ExternalNetwork(nn.Module):
    """A network loaded by spandrel: RGB in [0, 1], `(N, 3, H, W)` -> `(N, 3, scale*H, scale*W)`."""

    def __init__(self, descriptor: Any) -> None:
        """`descriptor`: a `spandrel.ImageModelDescriptor`."""
        super().__init__()
        self.network: nn.Module = _fold_branches(descriptor.model.float()).requires_grad_(True)
        self.scale = int(descriptor.scale)

    def forward(self, image: Tensor) -> Tensor:
        """See the class. If there are several outputs, the first is the picture, as in MMRealSR."""
        output = self.network(image)
        picture: Tensor = output[0] if isinstance(output, tuple) else output
        return picture


def _fold_branches(network: nn.Module) -> nn.Module:
    """Folds the branches of SPAN's Conv3XC once. By itself it folds them in each call, which can't be traced."""
    modules: Iterable[Any] = network.modules()
    for module in modules:
        if hasattr(module, "update_params") and hasattr(module, "eval_conv"):
            module.update_params()
            module.update_params = _do_nothing
            del module.conv, module.sk
    return network


def _do_nothing() -> None:
    """Takes the place of the folding, which has been done already."""


def export_weights(
    weights: Path, out: Path, *, name: str = "", accuracy_on: Sequence[Path] = (), degradation: str = ""
) -> Path:
    """Writes `NAME.onnx` and `NAME.json` into `out` and returns the card's path. NAME is the file's stem if not given.

    `weights`: a file with one of `SUFFIXES`; nothing in it is executed. `accuracy_on`, `degradation`: as for
    `export.export_network`.

    Raises `ValueError` if the file can't be read, holds no network for upscaling RGB that spandrel knows, or the
    network can't be exported with free sizes or used in tiles.
    """
    name = choose_name(name, weights.stem)
    descriptor = _load_descriptor(weights)
    network, sizes = ExternalNetwork(descriptor).eval(), _convert_sizes(descriptor.size_requirements)
    _check_call(network, descriptor, sizes)
    made = to_onnx.convert_network(network, network.scale, sizes)
    export.compare_with_torch(network, made, sizes)
    card = export.make_card(
        network,
        name=name,
        kind=f"{descriptor.architecture.name} ({', '.join(descriptor.tags)}), trained by others".replace(" ()", ""),
        scale=network.scale,
        radius=measure.find_tile_overlap(network, network.scale, sizes),
        sizes=sizes,
        training=cards.Training(_describe_file(weights), "unknown", 0, 0),
    )
    return export.write_network(made, card, out, accuracy_on=accuracy_on, degradation=degradation)


def _describe_file(weights: Path) -> dict[str, Any]:
    return {"weights": weights.name, "sha256": hashlib.sha256(weights.read_bytes()).hexdigest()}


def _load_descriptor(weights: Path) -> Any:
    """Loads spandrel's descriptor of the network in a file."""
    with without_torchvision():
        import spandrel
    try:
        descriptor = spandrel.ModelLoader().load_from_state_dict(
            spandrel.canonicalize_state_dict(_read_weights(weights))
        )
    except spandrel.UnsupportedModelError as error:
        raise ValueError(
            f"{weights}: spandrel {spandrel.__version__} knows no network with these weights; give one from its list"
        ) from error
    except (RuntimeError, KeyError, AssertionError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise ValueError(f"{weights}: its weights don't fit the network that they look like ({reason})") from error
    channels = (descriptor.input_channels, descriptor.output_channels)
    if not isinstance(descriptor, spandrel.ImageModelDescriptor) or descriptor.scale < 2 or channels != (3, 3):
        raise ValueError(
            f"{weights}: {descriptor.architecture.name} at scale {descriptor.scale} with {channels[0]} channels in and "
            f"{channels[1]} out; give a network that upscales RGB, 3 in and 3 out, by 2 or more"
        )
    return descriptor


def _read_weights(weights: Path) -> dict[str, Any]:
    """Reads the tensors by name, without unpickling anything else."""
    if weights.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{weights}: not a file of weights; give one of {', '.join(SUFFIXES)}")
    try:
        if weights.suffix.lower() == ".safetensors":
            from safetensors import SafetensorError
            from safetensors.torch import load_file

            try:
                return dict(load_file(weights))
            except SafetensorError as error:
                raise ValueError(str(error)) from error
        state = torch.load(weights, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError) as error:
        raise ValueError(
            f"{weights}: holds no weights that can be read without running code; give it as .safetensors, or as a "
            "state dict written by torch.save"
        ) from error
    if isinstance(state, dict) and state.keys() >= checkpoints.KEYS:
        raise ValueError(f"{weights}: a checkpoint of `ciir train`; give it without --weights")
    if not isinstance(state, dict) or not all(isinstance(key, str) for key in state):
        raise ValueError(
            f"{weights}: holds a {type(state).__name__}, not tensors by name; give a state dict written by torch.save"
        )
    return state


def _convert_sizes(rule: Any) -> Sizes:
    """Converts spandrel's `SizeRequirements`. The minimum is at least that of our own networks."""
    return Sizes(max(Sizes().minimum, rule.minimum), rule.multiple_of, rule.square)


@torch.no_grad()
def _check_call(network: ExternalNetwork, descriptor: Any, sizes: Sizes) -> None:
    """Raises `ValueError` if spandrel's result differs from `network`'s, because some models need further steps."""
    image = torch.rand(1, 3, *sizes.round_up(24, 24), generator=torch.Generator().manual_seed(0))
    difference = float((network(image).clamp(0, 1) - descriptor(image)).abs().max())
    if not difference <= export.TOLERANCE:
        raise ValueError(f"{descriptor.architecture.name}: needs steps besides its network; it can't be exported")


@contextmanager
def without_torchvision() -> Iterator[None]:
    """Makes it possible to import spandrel without torchvision within the block.

    The CPU build of torch often comes without torchvision. spandrel uses three of its functions for two networks that
    don't upscale (see `UNUSED`). Within the block they are replaced by functions that raise `ModuleNotFoundError`.
    """
    if "spandrel" in sys.modules or "torchvision" in sys.modules:
        yield
        return

    def absent(*_: object, **__: object) -> NoReturn:
        raise ModuleNotFoundError("spandrel was imported without torchvision", name="torchvision")

    names = ("torchvision", "torchvision.transforms", "torchvision.transforms.functional")
    stubs = {name: types.ModuleType(name) for name in names}
    for name in UNUSED:
        setattr(stubs[names[-1]], name, absent)
    sys.modules.update(stubs)
    try:
        yield
    finally:
        for name in names:
            del sys.modules[name]
