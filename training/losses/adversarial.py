"""The adversarial game: its losses, an update of the discriminator, and a watch over it.

Public logs of SRGAN's recipe show the discriminator dead from epoch 7 or 9 on while training went on for days: every
picture, real or made, is judged 1.0, or made ones 1e-9. From then on the generator learns nothing from it.
"""

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
    """The two players' losses, scalars, of logits `(N,)` float32."""

    generator: Callable[[Tensor], Tensor]
    """Of the made pictures' logits."""
    discriminator: Callable[[Tensor, Tensor], Tensor]
    """Of the real and of the made pictures' logits, the mean of the two halves."""


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

`bce`: binary cross entropy of the logits, -log D(made) for the generator (Goodfellow et al., NeurIPS 2014, section 3;
SRGAN, equation 6); the discriminator's is log 2 while it guesses. `hinge`: Lim and Ye 2017 (arXiv:1705.02894); the
discriminator's is 1 while it guesses.
"""


def find_losses(name: str) -> AdversarialLosses:
    """What a recipe's `adversarial` names. Raises `ValueError` where there is none."""
    if name not in LOSSES:
        raise ValueError(f"adversarial: {name!r} is not known; give one of {', '.join(LOSSES)}, or none")
    return LOSSES[name]


@dataclass
class SaturationWatch:
    """Notices a discriminator that is of no more use to the generator.

    After the first `start` updates (a pretrained generator's pictures are easy to tell at first, and an untrained
    discriminator judges all alike), each update is looked at. The run ends when `patience` of them on end were

    - won: the discriminator's loss was below `doubt` divided by the number of pictures, real and made. A single one
      that is in doubt adds log(2) = 0.69 divided by that (hinge: 1), so not one was; its gradient is gone.
    - or blind: the probabilities (sigmoid of the logits) that it gave all pictures, real and made, lay within
      `spread` of each other, whatever they were. The logs' "all are 1.0" is this case.
    """

    start: int = 500
    patience: int = 300
    doubt: float = 0.64
    spread: float = 0.01

    updates: int = 0
    won: int = 0
    """How many of the last updates on end were won."""
    blind: int = 0
    """How many of the last updates on end were blind."""

    def record(self, loss: float, real: Tensor, made: Tensor) -> None:
        """Counts one update of the discriminator. Raises `ValueError` where it has saturated."""
        self.updates += 1
        if self.updates <= self.start:
            return
        probabilities = torch.cat([real, made]).sigmoid()
        floor = self.doubt / len(probabilities)
        self.won = self.won + 1 if loss < floor else 0
        self.blind = self.blind + 1 if (probabilities.max() - probabilities.min()).item() < self.spread else 0
        if self.won >= self.patience:
            raise ValueError(
                f"the discriminator has told all real pictures from all made ones since update "
                f"{self.updates - self.won + 1} (loss below {floor:.2g}, {self.won} times on end) and guides the "
                "generator no longer; lower learning_rate, pretrain the generator for longer, or take adversarial = "
                '"hinge"'
            )
        if self.blind >= self.patience:
            raise ValueError(
                f"the discriminator has judged all pictures alike, real or made, since update "
                f"{self.updates - self.blind + 1} (within {self.spread}, {self.blind} times on end) and guides the "
                'generator no longer; lower learning_rate or adversarial_weight, or take adversarial = "hinge"'
            )


class Adversary:
    """A discriminator with its losses, its optimiser (Adam) and its watch."""

    def __init__(self, name: str, network: Discriminator, *, bfloat16: bool = False) -> None:
        """`name`: key of `LOSSES`. `network`: on the device of its pictures. `bfloat16`: run it in bfloat16."""
        self.losses = find_losses(name)
        self.network = network
        self.bfloat16 = bfloat16
        self.optimiser = torch.optim.Adam(network.parameters())
        self.watch = SaturationWatch()

    def judge(self, output: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The generator's loss, a scalar, and the feature maps of its pictures; gradients pass to `output` alone."""
        # The generator's step has no use for gradients of these weights, a third of the work.
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
        """The feature maps of real pictures, without gradients."""
        with self._autocast(high):
            return self.network.features(high)

    def update(self, output: Tensor, high: Tensor, rate: float) -> dict[str, float]:
        """One step of size `rate` on made pictures (detached here) and real ones; returns its `discriminator_loss`, and
        `discriminator_accuracy`, the share of the pictures that it told right before the step.

        Raises `FloatingPointError` where the loss is not a number; `ValueError` where the discriminator is saturated.
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
        """All that a resumed run needs to go on bit for bit."""
        return {
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "watch": asdict(self.watch),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Goes on from what `state_dict` returned."""
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.watch = SaturationWatch(**state["watch"])

    def _autocast(self, image: Tensor) -> torch.autocast:
        return torch.autocast(image.device.type, torch.bfloat16, enabled=self.bfloat16)
