"""A training run in one TOML file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, get_origin, get_type_hints

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class Recipe:
    """What a run is made of. Every field may stand in the file; those without a default must."""

    name: str
    """The network's name in the catalogue, and the stem of its files."""
    network: str
    """Key of `training.networks.NETWORKS`."""
    train: str
    """Folder of training pictures, or of VOC2012 as it unpacks."""
    validate: str
    """Folder of `*_HR.png` and `*_LR.png` pairs."""
    steps: int
    """Optimiser steps."""
    options: dict[str, Any] = field(default_factory=dict)
    """Keyword arguments of the network's constructor."""
    initial: str = ""
    """Checkpoint whose weights the run starts from; empty: from random ones."""

    degradations: dict[str, Any] = field(default_factory=lambda: {"bicubic": 1.0})
    """How the LR of a crop was made -> its share of the crops: see `training.data`."""
    scenes: int = 0
    """Random scenes that are rendered as training pairs beside the photographs (see `training.rendered`)."""
    meshes: list[Any] = field(default_factory=list)
    """Mesh files whose views join the random scenes'."""
    noise: float = 0.0
    """Largest standard deviation of Gaussian noise on LR, in 8-bit levels; each crop draws its own up to it."""
    blur: float = 0.0
    """Largest standard deviation of a Gaussian blur of LR, in LR pixels; each crop draws its own up to it."""
    jpeg: int = 0
    """Lowest JPEG quality (1 to 100) that an LR crop goes through, each crop draws its own from it up; 0: none does."""
    scale: int = 2
    crop: int = 88
    """HR crop side, pixels."""
    batch: int = 16

    loss: str = "l1"
    """Pixel loss: `l1`, `mse` or `charbonnier` (see `training.losses`)."""
    perceptual: str = ""
    """Perceptual term: `vgg19`, `gradient`, `frequency`, `discriminator`, or none (see `training.perceptual`)."""
    perceptual_weight: float = 1.0
    vgg: str = ""
    """torchvision's VGG-19 weight file, for `perceptual = "vgg19"`."""
    adversarial: str = ""
    """Adversarial term: `bce` (with logits), `hinge`, or none (see `training.adversary`)."""
    adversarial_weight: float = 1e-3

    learning_rate: float = 1e-4
    """Adam's peak step size; it falls to zero along a half cosine. The discriminator's too."""
    warmup: int = 0
    """Steps over which the step size rises linearly from zero."""
    clip: float = 0.0
    """Largest gradient norm; 0 leaves gradients as they are."""
    ema: float = 0.0
    """Decay of the running mean of the weights, which is what is validated and exported; 0: the weights themselves."""
    device: str = "auto"
    """`cpu`, `cuda`, or `auto`: CUDA where there is a GPU."""
    bfloat16: bool = False
    """Run the forward and backward pass in bfloat16 with float32 weights (several times faster on CPUs with AMX)."""
    seed: int = 0
    validate_every: int = 500
    """Steps between checkpoints, each with a validation."""


def read(path: Path) -> Recipe:
    """The recipe in `path`. Raises `ValueError` where it is no TOML, or names a key that is missing or unknown."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not TOML: {error}") from error
    known = {f.name for f in fields(Recipe)}
    unknown = sorted(set(table) - known)
    if unknown:
        raise ValueError(f"{path}: unknown key {unknown[0]!r}; known are {', '.join(sorted(known))}")
    for name, kind in get_type_hints(Recipe).items():
        wanted = get_origin(kind) or kind
        value = table.get(name, wanted())
        # TOML's true is no number of steps, though Python's is; and 1 is a fine float.
        if not isinstance(value, (float, int) if wanted is float else wanted) or (
            isinstance(value, bool) and wanted is not bool
        ):
            raise ValueError(
                f"{path}: {name} is {value!r}; give {'a table' if wanted is dict else 'a ' + wanted.__name__}"
            )
    try:
        return Recipe(**table)
    except TypeError as error:
        raise ValueError(f"{path}: {error}") from error
