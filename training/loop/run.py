"""The state of a training run and its update."""

from __future__ import annotations

import copy
import math
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, cast

import torch
from tqdm import tqdm

from ciir.training import recipe as recipes
from ciir.training.loop import checkpoints
from ciir.training.loop.initial import load_onnx_weights
from ciir.training.losses.objective import Objective
from ciir.training.networks import make_network

if TYPE_CHECKING:
    from torch import Tensor, nn

    from ciir.training.recipe import Recipe

    Inputs = Tensor | tuple[Tensor, ...]
    """A picture, or a tuple of all inputs of a network."""

CHECK_EVERY = {"cpu": 1, "cuda": 50}
"""Steps between checks of the loss. Each check makes the CPU wait for the GPU."""


class Run:
    """A network in training; a checkpoint holds its whole state."""

    def __init__(self, recipe: Recipe) -> None:
        """Starts from random weights that depend only on the seed. Raises `ValueError` if the recipe is wrong."""
        self.recipe, self.device = recipe, choose_device(recipe.device)
        torch.manual_seed(recipe.seed)
        network = make_network(recipe.network, recipe.options)
        if network.scale != recipe.scale:
            raise ValueError(f"scale is {recipe.scale}, but {recipe.network} is made for {network.scale}; see options")
        if self.device.type == "cuda":
            # By default float32 convolutions keep 10 bits, which are too few for the differences of a plane sweep.
            torch.backends.cudnn.allow_tf32 = False
            torch.backends.cudnn.benchmark = True  # all batches have one shape
        self.network: nn.Module = network.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.network)
        """The running mean of the weights, which is validated and exported."""
        if self.device.type == "cuda":
            self.network.compile()
        self.trained = [weight for weight in self.network.parameters() if weight.requires_grad]
        self.optimiser = torch.optim.Adam(self.trained, lr=recipe.learning_rate)
        self.objective = Objective(recipe, self.device)
        self.step, self.seconds, self.psnr, self.commit = 0, 0.0, math.nan, find_commit()

    @property
    def is_done(self) -> bool:
        """Whether the run has ended: its steps are done, or its time is up."""
        return self.step >= self.recipe.steps or 0 < 60 * self.recipe.minutes <= self.seconds

    def update(self, low: Inputs, high: Tensor) -> dict[str, Tensor | float]:
        """Updates the weights with LR `(N, 3, h, w)`, or all inputs of the network, and HR `(N, 3, H, W)`, float in
        [0, 1]. Returns the losses, with `loss` as their sum.

        Raises `FloatingPointError` if the loss or its gradient's norm is not finite, on CUDA within `CHECK_EVERY`
        steps; the weights are then lost. Raises `ValueError` if the discriminator has saturated.
        """
        inputs, high = [self._placed(part) for part in as_tuple(low)], self._placed(high)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.recipe.bfloat16):
            output = self.network(*inputs)
        output = output.float()
        terms = self.objective.generator(output, high)
        loss = torch.stack(list(terms.values())).sum()
        if self.checks_loss and not torch.isfinite(loss):
            raise FloatingPointError(f"step {self.step}: the loss is {loss.item()}; lower learning_rate or set clip")
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        # Checked even without clipping, because Adam would divide by its infinite square and silently stop learning.
        norm = torch.nn.utils.clip_grad_norm_(self.trained, self.recipe.clip or math.inf)
        if self.checks_loss and not torch.isfinite(norm):
            raise FloatingPointError(f"step {self.step}: the gradient's norm is {norm.item()}; lower learning_rate")
        rate = learning_rate(self.recipe, self.step, self.seconds)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.optimiser.step()
        update_average(self.average, self.network, min(self.recipe.ema, (self.step + 1) / (self.step + 10)))
        judged = self.objective.discriminator(output, high, rate)
        self.step += 1
        return {"loss": loss.detach(), **{name: term.detach() for name, term in terms.items()}, **judged}

    @property
    def checks_loss(self) -> bool:
        """Whether the loss of the next step is checked."""
        return self.step % CHECK_EVERY[self.device.type] == 0

    def _placed(self, image: Tensor) -> Tensor:
        if self.device.type == "cuda" and image.device.type == "cpu":
            image = image.pin_memory()
        layout = torch.channels_last if image.ndim == 4 else torch.preserve_format
        return image.to(self.device, non_blocking=True, memory_format=layout)

    def save(self, path: Path) -> None:
        """Writes the checkpoint. Raises the errors of `checkpoints.save_checkpoint`."""
        state = {
            "network": self.average.state_dict(),
            "raw": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "objective": self.objective.state_dict(),
            "step": self.step,
            "recipe": asdict(self.recipe),
            "commit": self.commit,
            "seconds": self.seconds,
            "psnr": self.psnr,
        }
        checkpoints.save_checkpoint(path, state)

    def resume(self, path: Path) -> None:
        """Resumes from a checkpoint of the same recipe. Raises `ValueError` if its recipe differs."""
        state = checkpoints.read_checkpoint(path)
        differs = recipes.find_difference(state["recipe"], self.recipe)
        if differs:
            raise ValueError(
                f"{path}: made by another recipe: {differs}; name another folder, and this checkpoint as `initial` "
                "to start from its weights"
            )
        try:
            self.network.load_state_dict(state["raw"])
            self.average.load_state_dict(state["network"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.objective.load_state_dict(state.get("objective", {}))
        except (RuntimeError, ValueError, LookupError, TypeError) as error:
            raise ValueError(
                f"{path}: made by an older version, whose runs can't continue here; name another folder, and this "
                "checkpoint as `initial`"
            ) from error
        self.step, self.seconds, self.commit = state["step"], state["seconds"], state["commit"]
        self.psnr = state.get("psnr", math.nan)

    def start_from(self, path: Path) -> None:
        """Loads the weights of another run's checkpoint. Raises `ValueError` if its network differs.

        Options that do not change the weights (a slope, for example) may differ; a line on stderr then names both. A
        light-field network loads the checkpoint of a single-picture generator into the one that it contains.
        """
        if path.suffix == ".onnx":
            load_onnx_weights(self.network, path)
            self.average.load_state_dict(self.network.state_dict())
            return
        try:
            state = checkpoints.read_checkpoint(path)
        except (OSError, ValueError) as error:
            raise ValueError(f"initial: {error}; train that first, or name another with --initial") from error
        there, here = (f"{r['network']} with {r['options']}" for r in (state["recipe"], asdict(self.recipe)))
        is_single = self.recipe.light_field and not state["recipe"].get("light_field", False)
        network = cast("nn.Module", self.network.single) if is_single else self.network
        try:
            network.load_state_dict(state["network"])
        except RuntimeError as error:  # torch's message is a page long
            raise ValueError(
                f"initial: {path} holds {there}, which is not this recipe's {here}; name another"
            ) from error
        if there != here and not is_single:
            tqdm.write(f"initial: {path} holds {there}, but continues as {here}", file=sys.stderr)
        self.average.load_state_dict(self.network.state_dict())


def as_tuple(inputs: Inputs) -> tuple[Tensor, ...]:
    """Returns the arguments of a network's call."""
    return (inputs,) if isinstance(inputs, torch.Tensor) else inputs


def choose_device(name: str) -> torch.device:
    """Finds the device that a recipe's `device` names. Raises `ValueError` if that is CUDA and there is no GPU."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError(
            f"device: cuda, but torch {torch.__version__} finds no GPU; give cpu, or install the driver "
            "and torch's build for CUDA"
        )
    return torch.device(name)


def learning_rate(recipe: Recipe, step: int, seconds: float = 0.0) -> float:
    """Computes Adam's step size at `step`, after `seconds`: a linear warm-up, then a half cosine down to zero."""
    if step < recipe.warmup:
        return recipe.learning_rate * (step + 1) / recipe.warmup
    done = (step - recipe.warmup) / max(1, recipe.steps - recipe.warmup)
    if recipe.minutes:
        done = max(done, seconds / (60 * recipe.minutes))
    return recipe.learning_rate * 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))


@torch.no_grad()
def update_average(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Updates a running mean of weights: `average = decay * average + (1 - decay) * network`. Buffers are copied."""
    torch._foreach_lerp_(
        list(average.parameters()), list(network.parameters()), 1.0 - decay
    )  # as in torch's own optimisers
    for name, buffer in average.named_buffers():
        buffer.copy_(network.get_buffer(name))


def find_commit() -> str:
    """Finds the commit of the running code, with `+` if the checkout differs from it; `unknown` outside a checkout."""
    folder = Path(__file__).parent

    def git(*words: str) -> str:
        run = subprocess.run(  # noqa: S603 - the words are this function's own
            ["git", *words],  # noqa: S607 - git is wherever its user has it
            cwd=folder,
            check=True,
            capture_output=True,
            text=True,
        )
        return run.stdout.strip()

    try:
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "-uno") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
