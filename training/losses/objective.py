"""The training objective: the weighted loss terms that a recipe names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from ciir.training.losses import perceptual
from ciir.training.losses.adversarial import Adversary, find_losses
from ciir.training.losses.pixel import find_pixel_loss
from ciir.training.networks.discriminator import Discriminator

if TYPE_CHECKING:
    from torch import Tensor

    from ciir.training.recipe import Recipe


class Objective:
    """The pixel loss, with the perceptual and adversarial terms that the recipe names.

    With `loss = "mse"`, `perceptual = "vgg19"` and `adversarial = "bce"` this is the paper's sum: MSE + VGG-19 content
    + 1e-3 adversarial (Wu et al., Applied Sciences 2024, 14(2), 656, section 2.2).

    Raises `ValueError` for an unknown name, for `vgg19` without its file or on crops below 16 pixels, and for
    `discriminator` features without an adversarial term, because that term trains the discriminator.
    """

    def __init__(self, recipe: Recipe, device: torch.device) -> None:
        self.recipe = recipe
        self.pixel = find_pixel_loss(recipe.loss)
        _check_terms(recipe)
        self.content: perceptual.VggContent | None = None
        if recipe.perceptual == "vgg19":
            self.content = perceptual.VggContent(Path(recipe.vgg), device, bfloat16=recipe.bfloat16)
        self.adversary: Adversary | None = None
        if recipe.adversarial:
            with torch.random.fork_rng(devices=[]):
                torch.default_generator.manual_seed(recipe.seed)
                network = _make_discriminator(recipe.discriminator)
            network = network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
            self.adversary = Adversary(recipe.adversarial, network, bfloat16=recipe.bfloat16)

    def generator(self, output: Tensor, high: Tensor) -> dict[str, Tensor]:
        """Computes the terms of the generator's loss: name -> weighted scalar.

        `output` and `high`: made and real pictures, `(N, 3, H, W)` float32, nominally in [0, 1]. The keys are the
        recipe's `loss` and `perceptual`, and `adversarial`.
        """
        recipe = self.recipe
        terms = {recipe.loss: self.pixel(output, high)}
        if self.content:
            terms[recipe.perceptual] = recipe.perceptual_weight * self.content(output, high)
        if self.adversary:
            adversarial, made = self.adversary.judge(output)
            if recipe.perceptual == "discriminator":
                real = self.adversary.features(high)
                terms[recipe.perceptual] = recipe.perceptual_weight * perceptual.feature_matching(made, real)
            terms["adversarial"] = recipe.adversarial_weight * adversarial
        return terms

    def discriminator(self, output: Tensor, high: Tensor, rate: float) -> dict[str, float]:
        """Updates the discriminator with step size `rate`; see `Adversary.update`. Empty if there is none.

        Raises `ValueError` if it has saturated, and `FloatingPointError` if its loss is not a number.
        """
        return self.adversary.update(output, high, rate) if self.adversary else {}

    def state_dict(self) -> dict[str, Any]:
        """Returns the state of the discriminator for a checkpoint; empty if there is none."""
        return self.adversary.state_dict() if self.adversary else {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restores what `state_dict` of the same recipe's objective returned."""
        if self.adversary:
            self.adversary.load_state_dict(state)


def _make_discriminator(options: dict[str, Any]) -> Discriminator:
    try:
        return Discriminator(**options)
    except TypeError as error:
        raise ValueError(f"discriminator: it doesn't take {options} ({error})") from error


def _check_terms(recipe: Recipe) -> None:
    if recipe.perceptual and recipe.perceptual not in perceptual.PERCEPTUAL:
        raise ValueError(
            f"perceptual: {recipe.perceptual!r} is not known; give one of {', '.join(perceptual.PERCEPTUAL)}, or none"
        )
    if recipe.adversarial:
        find_losses(recipe.adversarial)
    elif recipe.perceptual == "discriminator":
        raise ValueError('perceptual: "discriminator" needs one; set adversarial to "bce" or "hinge"')
    if recipe.perceptual == "vgg19" and not recipe.vgg:
        raise ValueError(f'vgg: empty, but perceptual = "vgg19" needs it; {perceptual.REMEDY}')
    if recipe.perceptual == "vgg19" and recipe.crop < 16:
        raise ValueError(f"crop: {recipe.crop} pixels are too few for VGG-19; give 16 or more")
