"""The training loop: updates, with validation, a row of the log and a checkpoint at regular intervals."""

from __future__ import annotations

import sys
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from ciir.training.data.crops import Crops
from ciir.training.data.light_field.crops import KEPT_BLOCKS, STEPS_PER_BLOCK, LightFieldCrops
from ciir.training.loop import light_field_validation, validation
from ciir.training.loop.interrupt import Stopped, catch_signals
from ciir.training.loop.logs import Log, Means, Progress
from ciir.training.loop.prefetch import prefetch_batches
from ciir.training.loop.run import Run, learning_rate
from ciir.training.networks.light_field import LightFieldGenerator

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import nn

    from ciir.training.loop.prefetch import Batch
    from ciir.training.recipe import Recipe

THREADS = {"cpu": 0, "cuda": 1}
"""Number of threads that prefetch batches. Batches are made on the device, so on a CPU threads would only slow down
the updates."""


def train(recipe: Recipe, out: Path) -> Path:
    """Runs `recipe` in `out`, from its checkpoint if there is one, and returns the checkpoint's path.

    After each `recipe.validate_every` steps `checkpoint.pt` and the files of `training.loop.logs.Log` are written to
    `out`. A resumed run continues bit for bit on the CPU, because the data and the step size depend only on the step.
    With `recipe.minutes` the step size depends on the time too.

    Ctrl-C and SIGTERM stop the run after the current step, with a checkpoint, by raising
    `training.loop.interrupt.Stopped`.

    Raises `FloatingPointError` if the loss or a weight is no longer a number. Raises `ValueError` if a folder or a
    checkpoint doesn't suit the recipe, the device is not available, or the discriminator has saturated. Raises
    `OSError` if the disk is full. The last good checkpoint is kept.
    """
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out}: a file is there; name a folder for the run")
    checkpoint = out / "checkpoint.pt"
    run = Run(recipe)
    _check_network(recipe, run.network)
    if checkpoint.exists():
        run.resume(checkpoint)
    elif recipe.initial:
        run.start_from(Path(recipe.initial))
    if run.is_done:
        return checkpoint
    score, batch_of = _load_data(recipe, run)

    out.mkdir(parents=True, exist_ok=True)
    report_start(recipe, run.step)
    log, means, begun = Log(out, title=recipe.name, step=run.step), Means(), time.monotonic() - run.seconds
    since, at = time.monotonic(), run.step
    with (
        Progress(run.step, recipe.steps, run.psnr, recipe.minutes, run.seconds) as progress,
        closing(prefetch_batches(batch_of, run.step, recipe.steps, **_choose_prefetch(recipe, run))) as coming,
        catch_signals() as signals,
    ):
        for low, high in coming:
            checks_loss = run.checks_loss
            run.seconds = time.monotonic() - begun
            losses = run.update(low, high)
            means.add(losses)
            progress.count_step(float(losses["loss"]) if checks_loss else None)
            due = run.step % recipe.validate_every == 0 or run.is_done
            if due:
                row = means.take()  # waits for the GPU
                pace = (time.monotonic() - since) / (run.step - at)
                run.psnr = score(run.average)
                rate = learning_rate(recipe, run.step - 1, run.seconds)
                row |= {"step": run.step, "learning_rate": rate, "psnr": run.psnr}
                run.seconds = time.monotonic() - begun
                log.add(row | {"seconds": run.seconds, "seconds_per_step": pace})
                progress.report_validation(run.step, loss=row["loss"], psnr=run.psnr, pace=pace, seconds=run.seconds)
                since, at = time.monotonic(), run.step
            if due or signals:
                run.seconds = time.monotonic() - begun
                run.save(checkpoint)
            if run.is_done:
                break
            if signals:
                raise Stopped(
                    f"stopped at step {run.step} of {recipe.steps}, saved in {checkpoint}; "
                    "continue with the same command",
                    signals[0],
                )
    return checkpoint


def report_start(recipe: Recipe, step: int) -> None:
    """Prints a line on stderr when a run starts, and a warning if it is too short for its warm-up."""
    stop = "stop with Ctrl-C, continue with the same command"
    end = f"for {recipe.minutes:g} minutes in all, at most to" if recipe.minutes else "to"
    tqdm.write(f"training {recipe.name}: from step {step} {end} {recipe.steps}; {stop}", file=sys.stderr)
    if recipe.warmup >= recipe.steps:
        tqdm.write(
            f"warmup: {recipe.warmup} of {recipe.steps} steps; the step size never reaches learning_rate",
            file=sys.stderr,
        )


def _check_network(recipe: Recipe, network: nn.Module) -> None:
    """Raises `ValueError` if the network does not take the batches of the recipe."""
    if isinstance(network, LightFieldGenerator) == recipe.light_field:
        return
    if recipe.light_field:
        raise ValueError(
            f'light_field is true, but {recipe.network} takes single pictures; set network = "light_field", or '
            "light_field = false"
        )
    raise ValueError(
        f"light_field is false, but {recipe.network} takes a window of views; set light_field = true, or name another"
    )


def _choose_prefetch(recipe: Recipe, run: Run) -> dict[str, int]:
    """Chooses how batches are prefetched. Layered scenes take as long as updates, so they get a thread on a CPU too."""
    threads = THREADS[run.device.type]
    return (
        {"threads": max(1, threads), "ready": (KEPT_BLOCKS - 1) * STEPS_PER_BLOCK}
        if recipe.light_field
        else {"threads": threads}
    )


def _load_data(recipe: Recipe, run: Run) -> tuple[Callable[[nn.Module], float], Callable[[int], Batch]]:
    """Loads the data of a recipe onto the run's device. Returns the function that validates a network, and the one that
    makes a step's batch.
    """
    names = ("crop", "scale", "batch", "seed", "degradations", "meshes")
    common: dict[str, Any] = {name: getattr(recipe, name) for name in names} | {"device": run.device}
    if isinstance(run.network, LightFieldGenerator):
        fields = light_field_validation.read_light_field(Path(recipe.validate), recipe.scale)
        views = LightFieldCrops(
            Path(recipe.train), **common, planes=run.network.planes, scenes=recipe.scenes, eased=recipe.eased
        )
        return lambda network: light_field_validation.validate_network(network, fields), views.make_batch
    pairs = validation.read_pairs(Path(recipe.validate), recipe.scale)
    corruption = {name: getattr(recipe, name) for name in ("scenes", "noise", "blur", "jpeg", "corrupted")}
    labelled = Path(recipe.labelled) if recipe.labelled else None
    crops = Crops(Path(recipe.train), **common, **corruption, labelled=labelled)
    return lambda network: validation.validate_network(network, pairs, recipe.scale), crops.make_batch
