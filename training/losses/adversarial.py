"""Adversarial losses, the update of the discriminator, and the detection of its saturation."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch.nn import functional

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

    from ciir.training.networks.discriminator import Discriminator


@dataclass(frozen=True)
class AdversarialLosses:
    """The losses of generator and discriminator: scalars computed from logits `(N,)` float32."""

    generator: Callable[[Tensor], Tensor]
    """Takes the made pictures' logits."""
    discriminator: Callable[[Tensor, Tensor], Tensor]
    """Takes the real and the made pictures' logits. The loss is the mean of the two halves."""


def _bce_generator(made: Tensor) -> Tensor:
    return functional.softplus(-made).mean()


def _bce_discriminator(real: Tensor, made: Tensor) -> Tensor:
    return 0.5 * (functional.softplus(-real).mean() + functional.softplus(made).mean())


def _hinge_generator(made: Tensor) -> Tensor:
    return -made.mean()


def _hinge_discriminator(real: Tensor, made: Tensor) -> Tensor:
    return 0.5 * ((1.0 - real).relu().mean() + (1.0 + made).relu().mean())


LOSSES = {
    "bce": AdversarialLosses(_bce_generator, _bce_discriminator),
    "hinge": AdversarialLosses(_hinge_generator, _hinge_discriminator),
}
"""A recipe's `adversarial` -> losses.

`bce`: binary cross entropy of the logits (Goodfellow et al., NeurIPS 2014, section 3; SRGAN, equation 6). `hinge`: Lim
and Ye 2017 (arXiv:1705.02894).
"""


def find_losses(name: str) -> AdversarialLosses:
    """Finds the losses that a recipe's `adversarial` names. Raises `ValueError` for an unknown name."""
    if name not in LOSSES:
        raise ValueError(f"adversarial: {name!r} is not known; give one of {', '.join(LOSSES)}, or none")
    return LOSSES[name]


@dataclass
class SaturationWatch:
    """Detects a discriminator that no longer helps the generator.

    After the first `start` updates the run ends if `patience` updates in a row were

    - won: the discriminator's loss was below `threshold` divided by the number of pictures, real and made. A single
      undecided picture adds log(2) = 0.69 (hinge: 1) divided by that number, so the gradient vanishes.
    - or blind: the probabilities (sigmoid of the logits) of all pictures were within `spread` of each other.
    """

    start: int = 500
    patience: int = 300
    threshold: float = 0.64
    spread: float = 0.01

    updates: int = 0
    won: int = 0
    """The number of updates in a row that were won."""
    blind: int = 0
    """The number of updates in a row that were blind."""

    def record(self, loss: float, real: Tensor, made: Tensor) -> None:
        """Counts one update of the discriminator. Raises `ValueError` if the discriminator has saturated."""
        self.updates += 1
        if self.updates <= self.start:
            return
        probabilities = torch.cat([real, made]).sigmoid()
        floor = self.threshold / len(probabilities)
        self.won = self.won + 1 if loss < floor else 0
        self.blind = self.blind + 1 if (probabilities.max() - probabilities.min()).item() < self.spread else 0
        if self.won >= self.patience:
            raise ValueError(
                f"the discriminator has separated all real pictures from all made ones since update "
                f"{self.updates - self.won + 1} (loss below {floor:.2g}, {self.won} times in a row); lower "
                'learning_rate, pretrain the generator for longer, or use adversarial = "hinge"'
            )
        if self.blind >= self.patience:
            raise ValueError(
                f"the discriminator has given all pictures the same value, real or made, since update "
                f"{self.updates - self.blind + 1} (within {self.spread}, {self.blind} times in a row); lower "
                'learning_rate or adversarial_weight, or use adversarial = "hinge"'
            )


class Adversary:
    """A discriminator with its losses, its optimiser (Adam) and its saturation watch."""

    def __init__(self, name: str, network: Discriminator, *, bfloat16: bool = False) -> None:
        """`name`: a key of `LOSSES`. `network`: on the device of its pictures. `bfloat16`: whether it runs in that."""
        self.losses = find_losses(name)
        self.network = network
        self.bfloat16 = bfloat16
        self.optimiser = torch.optim.Adam(network.parameters())
        self.watch = SaturationWatch()

    def judge(self, output: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Returns the generator's loss, a scalar, and its pictures' feature maps; gradients flow to `output` only."""
        # The generator's update doesn't need the gradients of these weights, which are a third of the work.
        self.network.requires_grad_(False)
        try:
            with self._autocast(output):
                features = self.network.features(output)
                logits = self.network.logits(features)
        finally:
            self.network.requires_grad_(True)
        return self.losses.generator(logits.float()), features

    @torch.no_grad()
    def features(self, high: Tensor) -> list[Tensor]:
        """Returns the feature maps of real pictures, without gradients."""
        with self._autocast(high):
            return self.network.features(high)

    def update(self, output: Tensor, high: Tensor, rate: float) -> dict[str, float]:
        """Takes one step of size `rate` on made pictures (detached here) and real ones. Returns `discriminator_loss`,
        and `discriminator_accuracy`, the share of pictures that were classified correctly before the step.

        Raises `FloatingPointError` if the loss is not a number, and `ValueError` if the discriminator has saturated.
        """
        with self._autocast(high):
            real, made = self.network(high), self.network(output.detach())
        real, made = real.float(), made.float()
        loss = self.losses.discriminator(real, made)
        if not torch.isfinite(loss):
            raise FloatingPointError(f"the discriminator's loss is {loss.item()}; lower learning_rate")
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.watch.record(loss.item(), real.detach(), made.detach())
        accuracy = torch.cat([real > 0, made < 0]).float().mean()
        return {"discriminator_loss": loss.item(), "discriminator_accuracy": accuracy.item()}

    def state_dict(self) -> dict[str, Any]:
        """Returns the state that a resumed run needs to continue bit for bit."""
        return {
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "watch": asdict(self.watch),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.watch = SaturationWatch(**state["watch"])

    def _autocast(self, image: Tensor) -> torch.autocast:
        return torch.autocast(image.device.type, torch.bfloat16, enabled=self.bfloat16)
