"""Training: losses and gradients stay finite at large step sizes, bfloat16 stays near float32, and NaN is caught."""

from __future__ import annotations

import math
import tempfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.benchmarks.stress.case import Found, skip_without
from ciir.renderer.scenes.modelling import sample_noise, to_rgba
from ciir.renderer.writers.pictures import encode
from ciir.training import recipe as recipes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from torch import Tensor

    from ciir.benchmarks.stress.case import Case, Effort, Skipped
    from ciir.training.data.crops import Crops
    from ciir.training.loop.run import Run
    from ciir.training.recipe import Recipe

DESIGNS = {"fast": "fast", "quality": "quality", "paper": "paper", "gan": "gan", "paper's adversary": "paper-vgg"}
"""Name -> the recipe that gives the network, losses, clipping and precision."""
RATES = (1e-4, 1e-3, 1e-2)
REFUSED = ("paper's adversary", 1e-2)
"""MSE diverges at steps of 1e-2, with clipping and without, and the run must end with an error. The paper's step size
is a hundredth of this."""
UPDATES, QUICK_UPDATES = 200, 10
CROP, BATCH = 24, 2
LARGEST = math.sqrt(3.4028e38)
"""A norm is the root of a sum of squares: above this, the sum is infinite in float32."""
ROUNDING = 2.0**-8
"""The relative error of a rounding to bfloat16, whose significand has 8 bits."""
LAYERS = 16
"""Convolutions one after another: the paper's network has as many, and so has gan's with its discriminator."""


def _recipe(design: str, *, rate: float = 1e-3, updates: int = 1) -> Recipe:
    """Returns the design's recipe from random weights on small crops, on the CPU, at a step size that hardly falls."""
    folder = Path(recipes.__file__).parent / "recipes"
    recipe = recipes.read_recipe(folder / f"{DESIGNS[design]}.toml")
    return replace(
        recipe,
        initial="",
        degradations={"bicubic": 1.0},
        scenes=0,
        perceptual="" if recipe.perceptual == "vgg19" else recipe.perceptual,  # its weights are not ours to ship
        crop=CROP,
        batch=BATCH,
        learning_rate=rate,
        warmup=0,
        steps=10 * updates,
        device="cpu",
    )


@contextmanager
def _crops(recipe: Recipe) -> Iterator[Crops]:
    """Yields crops of four generated pictures: smooth, rough, and cut by edges."""
    from ciir.training.data.crops import Crops

    with tempfile.TemporaryDirectory() as folder:
        y, x = np.mgrid[:96, :128] / 64.0
        for seed in range(4):
            points = np.stack([x, y, np.full_like(x, seed)], axis=-1)
            colors = np.stack(
                [sample_noise(points, frequency=2.0**seed, octaves=4, seed=3 * seed + c) for c in range(3)], -1
            )
            picture = to_rgba(0.5 + 0.5 * np.where(colors[..., :1] > 0.2, 1.0, colors))[..., :3]
            (Path(folder) / f"{seed}.png").write_bytes(encode(picture, ".png"))
        yield Crops(
            Path(folder),
            crop=recipe.crop,
            scale=recipe.scale,
            batch=recipe.batch,
            seed=recipe.seed,
            degradations=recipe.degradations,
        )


class Updated(NamedTuple):
    """The result of one update."""

    loss: float
    gradient: list[Tensor]
    """Gradients of each weight of the generator, before clipping."""

    @property
    def norm(self) -> float:
        """The gradient's norm, in float64, where large ones stay finite."""
        return math.sqrt(sum(float(part.double().square().sum()) for part in self.gradient))


def _update(run: Run, low: Tensor, high: Tensor) -> Updated:
    """Makes one update of `run`, and returns its gradient before clipping."""
    gradient: list[Tensor] = []

    def keep(weight: Tensor) -> None:
        assert weight.grad is not None  # noqa: S101 - torch calls this once it is there
        gradient.append(weight.grad.clone())

    hooks = [weight.register_post_accumulate_grad_hook(keep) for weight in run.trained]
    try:
        losses = run.update(low, high)
    finally:
        for hook in hooks:
            hook.remove()
    return Updated(float(losses["loss"]), gradient)


@skip_without("torch", "200 updates")
def stays_finite(effort: Effort) -> Iterator[Found | Skipped]:
    """Measures loss and gradient norm over 200 updates from random weights, without a warm-up, at step sizes up to
    1e-2.
    """
    from ciir.training.loop.run import Run

    updates = QUICK_UPDATES if effort.quick else UPDATES
    for design in ("gan",) if effort.quick else DESIGNS:
        for rate in RATES[-1:] if effort.quick else RATES:
            recipe = _recipe(design, rate=rate, updates=updates)
            loss, norm, where = 0.0, 0.0, ""
            with _crops(recipe) as crops:
                run = Run(recipe)
                try:
                    for step in range(updates):
                        updated = _update(run, *crops.make_batch(step))
                        loss, norm = max(loss, updated.loss), max(norm, updated.norm)
                except FloatingPointError as error:
                    loss = norm = math.nan
                    where = str(error)
            what = f"{design} at {rate:g}, {updates} updates"
            if (design, rate) == REFUSED:
                is_silent = not max(loss, norm) <= LARGEST and "lower learning_rate" not in where
                yield Found(f"{what}: diverged without an error", 0.0, float(is_silent), where)
                continue
            yield Found(f"{what}: largest loss", LARGEST, loss, where)
            yield Found(f"{what}: largest gradient norm", LARGEST, norm, where)


@skip_without("torch", "bfloat16 against float32")
def bfloat16(effort: Effort) -> Iterator[Found | Skipped]:
    """Compares the first update in bfloat16 with the same in float32: its loss, and its gradient as one long vector."""
    from ciir.training.loop.run import Run

    for design in ("fast",) if effort.quick else DESIGNS:
        recipe = _recipe(design)
        with _crops(recipe) as crops:
            low, high = crops.make_batch(0)
        half, single = (_update(Run(replace(recipe, bfloat16=short)), low, high) for short in (True, False))
        apart = Updated(0.0, [one - other for one, other in zip(half.gradient, single.gradient, strict=True)])
        # Each layer's weights and outputs are rounded on the way forward; independent errors add as a root. On the way
        # back its weights and gradients are, too; twice that for samples on the other side of a ReLU, or of L1's kink.
        forward, both = (math.sqrt(2 * LAYERS * ways) * ROUNDING for ways in (1, 2))
        yield Found(f"{design}: loss, relative", forward, abs(half.loss - single.loss) / single.loss)
        yield Found(f"{design}: gradient, relative", 2 * both, apart.norm / single.norm)


@skip_without("torch", "NaN in training")
def guards(effort: Effort) -> Iterator[Found | Skipped]:  # noqa: ARG001 - a case's signature
    """Checks that NaN in a picture, a weight or the discriminator, or an infinite gradient, ends the run and is not
    saved.
    """
    import torch

    from ciir.training.loop.run import Run

    recipe = _recipe("gan")
    with _crops(recipe) as crops:
        low, high = crops.make_batch(0)
    far = torch.full_like(high, 1e16)  # its loss is finite, the square of its gradient's norm is not
    run = Run(replace(recipe, loss="mse"))
    yield Found(
        "an infinite gradient, let through", 0.0, _let_through(run, 1e12 * low, far, "the gradient's norm is inf")
    )
    broken = low.clone()
    broken[0, 1, 2, 3] = torch.nan
    yield Found("NaN in a picture, let through", 0.0, _let_through(Run(recipe), broken, high))
    run = Run(recipe)
    assert run.objective.adversary is not None  # noqa: S101 - the recipe has one
    for what, network in (("a weight", run.network), ("the discriminator", run.objective.adversary.network)):
        weight = next(network.parameters())
        kept = weight.detach().clone()
        weight.data[(0,) * weight.ndim] = torch.nan
        yield Found(f"NaN in {what}, let through", 0.0, _let_through(run, low, high))
        weight.data.copy_(kept)
    run.average.load_state_dict(run.network.state_dict())
    next(run.average.parameters()).data.fill_(torch.nan)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint.pt"
        try:
            run.save(path)
            saved = 1.0
        except FloatingPointError as error:
            saved = float("a weight is not a number" not in str(error) or path.exists())
    yield Found("NaN in a checkpoint's weight, saved", 0.0, saved)


def _let_through(run: Run, low: Tensor, high: Tensor, text: str = "the loss is nan") -> float:
    """Returns 0 if the update is refused in one line that names the step and contains `text`; 1 otherwise."""
    try:
        run.update(low, high)
    except FloatingPointError as error:
        return float(f"step 0: {text}" not in str(error) or "\n" in str(error))
    return 1.0


CASES: tuple[Case, ...] = (stays_finite, bfloat16, guards)
