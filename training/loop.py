"""The training loop: Adam, pixel loss, half-cosine step size, atomic checkpoints, exact resume."""

from __future__ import annotations

import copy
import csv
import math
import subprocess
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from tqdm import tqdm

from models.metrics import luma, psnr
from training import checkpoints
from training.data import Crops, read_picture
from training.degrade import to_tensor
from training.networks import make

if TYPE_CHECKING:
    from torch import nn

    from training.recipe import Recipe


def learning_rate(recipe: Recipe, step: int) -> float:
    """Adam's step size at `step`: a linear warm-up, then a half cosine down to zero at `recipe.steps`."""
    if step < recipe.warmup:
        return recipe.learning_rate * (step + 1) / recipe.warmup
    done = (step - recipe.warmup) / max(1, recipe.steps - recipe.warmup)
    return recipe.learning_rate * 0.5 * (1.0 + math.cos(math.pi * done))


def commit() -> str:
    """The commit of the code that runs, with `+` where the checkout differs from it; `unknown` outside a checkout."""
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


@torch.no_grad()
def validate(network: nn.Module, folder: Path, scale: int) -> float:
    """Mean Y-PSNR in dB over the pairs in `folder`, by the published protocol (8-bit outputs, border cut)."""
    network.eval()
    scores = []
    for low_file in sorted(folder.glob("*_LR.png")):
        high = read_picture(low_file.with_name(low_file.name.replace("_LR", "_HR"))).numpy()
        output = network(to_tensor(read_picture(low_file)))[0].permute(1, 2, 0)
        picture = output.clamp(0, 1).mul(255).round().byte().numpy()
        scores.append(psnr(luma(picture), luma(high), border=scale))
    network.train()
    if not scores:
        raise ValueError(f"{folder}: no *_LR.png in it; name a folder of *_LR.png and *_HR.png pairs")
    return sum(scores) / len(scores)


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Moves the weights of `average` to `decay` times themselves plus the rest of `network`'s; buffers are copied."""
    for mean, weight in zip(average.parameters(), network.parameters(), strict=True):
        mean.lerp_(weight, 1.0 - decay)
    for name, buffer in average.named_buffers():
        buffer.copy_(network.get_buffer(name))


def train(recipe: Recipe, out: Path) -> Path:
    """Runs `recipe` in `out`, from its checkpoint where one is there, and returns the checkpoint's path.

    `out` gets `checkpoint.pt` and `log.csv` (step, loss, learning rate, validation PSNR in dB, seconds). A resumed
    run continues bit for bit on the CPU: the data and the step size depend on the step alone.

    Raises `FloatingPointError` when the loss is no longer a number; `ValueError` where `out` holds another recipe's
    checkpoint.
    """
    torch.manual_seed(recipe.seed)
    out.mkdir(parents=True, exist_ok=True)
    checkpoint, log = out / "checkpoint.pt", out / "log.csv"
    network = make(recipe.network, recipe.options).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    average = copy.deepcopy(network)
    trained = [weight for weight in network.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(trained, lr=recipe.learning_rate)
    start, source, seconds = 0, commit(), 0.0
    if checkpoint.exists():
        state = checkpoints.read(checkpoint)
        if state["recipe"] != asdict(recipe):
            raise ValueError(f"{checkpoint}: made by another recipe; name another folder or remove it")
        network.load_state_dict(state["raw"])
        average.load_state_dict(state["network"])
        optimiser.load_state_dict(state["optimiser"])
        start, source, seconds = state["step"], state["commit"], state["seconds"]
    else:
        if recipe.initial:
            network.load_state_dict(checkpoints.read(Path(recipe.initial))["network"])
            average.load_state_dict(network.state_dict())
        log.write_text("step,loss,learning_rate,psnr,seconds\n")
    crops = Crops(
        Path(recipe.train),
        crop=recipe.crop,
        scale=recipe.scale,
        batch=recipe.batch,
        seed=recipe.seed,
        degradations=recipe.degradations,
        scenes=recipe.scenes,
    )

    begun, total = time.monotonic() - seconds, 0.0
    for step in tqdm(range(start, recipe.steps), initial=start, total=recipe.steps, disable=None, unit="step"):
        low, high = (t.contiguous(memory_format=torch.channels_last) for t in crops.at(step))
        with torch.autocast("cpu", torch.bfloat16, enabled=recipe.bfloat16):
            output = network(low)
        loss = (output.float() - high).abs().mean()
        if not torch.isfinite(loss):
            raise FloatingPointError(f"step {step}: the loss is {loss.item()}; lower learning_rate or set clip")
        optimiser.zero_grad()
        loss.backward()
        if recipe.clip:
            torch.nn.utils.clip_grad_norm_(trained, recipe.clip)
        rate = learning_rate(recipe, step)
        for group in optimiser.param_groups:
            group["lr"] = rate
        optimiser.step()
        follow(average, network, min(recipe.ema, (step + 1) / (step + 10)))
        total += loss.item()
        done = step + 1
        if done % recipe.validate_every == 0 or done == recipe.steps:
            seconds = time.monotonic() - begun
            score = validate(average, Path(recipe.validate), recipe.scale)
            with log.open("a", newline="") as file:
                since = (done - 1) % recipe.validate_every + 1
                csv.writer(file).writerow([done, total / since, rate, score, round(seconds, 1)])
            total = 0.0
            state = {
                "network": average.state_dict(),
                "raw": network.state_dict(),
                "optimiser": optimiser.state_dict(),
                "step": done,
                "recipe": asdict(recipe),
                "commit": source,
                "seconds": seconds,
                "psnr": score,
            }
            checkpoints.save(checkpoint, state)
    return checkpoint
