"""One network for every degradation, against a specialist on each: the same network trained on with that one alone.

    python -m benchmarks.specialists runs/fast/checkpoint.pt [--updates 3000] [--out runs/specialists]

Every specialist starts from the given checkpoint and gets `--updates` more, all of its own kind, with the same
pictures, crops and batch. Tests: Set5 and Set14, degraded by `training.degrade`; for `pinhole` and `lenslet`, rendered
scenes that no run saw, with those photographs as textures. Mean Y-PSNR in dB, a border of `scale` pixels cut. Needs the
training extra.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from models.baselines import Bicubic
from models.metrics import luma, psnr
from training import checkpoints, degrade, export, pictures, rendered
from training.data import RENDERED
from training.loop import train
from training.recipe import Recipe

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

SETS = Path("../shared/data/images")
UNSEEN = 999
"""Seed of the test's scenes; recipes have others."""
SCENES = 24


def tests(kind: str, scale: int) -> list[degrade.Pair]:
    """Pairs `(LR, HR)` of degradation `kind`, `(3, h, w)` 8 bit."""
    files = [path for name in ("Set5", "Set14") for path in sorted((SETS / name).glob("*_HR.png"))]
    photographs = [pictures.read_rgb(path) for path in files]
    if kind in degrade.KINDS:
        return [degrade.pair(kind, torch.from_numpy(picture).permute(2, 0, 1), scale) for picture in photographs]
    which = RENDERED.index(kind)
    pairs = [rendered.pairs(photographs, seed=UNSEEN, index=index)[which] for index in range(SCENES)]
    return [tuple(torch.from_numpy(picture).permute(2, 0, 1) for picture in pair) for pair in pairs]  # type: ignore[misc]


@torch.no_grad()
def score(network: Callable[[Tensor], Tensor], pairs: list[degrade.Pair], scale: int) -> float:
    """Mean Y-PSNR in dB."""
    scores = []
    for low, high in pairs:
        output = network(low[None].float() / 255)[0].clamp(0, 1).mul(255).round().byte()
        got, truth = (luma(picture.permute(1, 2, 0).numpy()) for picture in (output, high))
        scores.append(psnr(got, truth, border=scale))
    return float(np.mean(scores))


def bicubic(low: Tensor) -> Tensor:
    """Interpolation, as in `models`."""
    return torch.from_numpy(Bicubic(2)(low.numpy()))


def main(argv: list[str] | None = None) -> int:
    """Trains the specialists (again: goes on where it stopped) and prints a row for each degradation."""
    parser = argparse.ArgumentParser(prog="benchmarks.specialists", description=main.__doc__)
    parser.add_argument("checkpoint", type=Path, help="of the network that serves every degradation")
    parser.add_argument("--kinds", nargs="+", default=[*degrade.KINDS, *RENDERED], choices=[*degrade.KINDS, *RENDERED])
    parser.add_argument("--updates", type=int, default=3000, help="of each specialist (default 3000)")
    parser.add_argument("--learning-rate", type=float, default=2e-4, help="its peak (default 2e-4)")
    parser.add_argument("--out", type=Path, default=Path("runs/specialists"), help="(default runs/specialists)")
    given = parser.parse_args(argv)
    state = checkpoints.read(given.checkpoint)
    recipe = Recipe(**state["recipe"])
    if recipe.scale != 2:
        parser.error(f"{given.checkpoint}: made for scale {recipe.scale}; scale 2 is what is tested here")
    given.out /= f"{recipe.name}-{state['commit'][:8]}-{state['step']}-{given.updates}"  # of these weights, no others
    sys.stdout.write(f"{'degradation':12s}{'bicubic':>9s}{recipe.name:>10s}{'specialist':>12s}{'behind':>8s}\n")
    for kind in given.kinds:
        special = replace(
            recipe,
            name=f"{recipe.name}-{kind}",
            initial=str(given.checkpoint),
            degradations={kind: 1.0},
            scenes=(recipe.scenes or 400) if kind in RENDERED else 0,
            meshes=recipe.meshes if kind in RENDERED else [],
            steps=given.updates,
            learning_rate=given.learning_rate,
            warmup=100,
        )
        pairs = tests(kind, recipe.scale)
        trained = train(special, given.out / kind)
        networks = (export.from_checkpoint(state), export.from_checkpoint(checkpoints.read(trained)))
        scores = [score(each, pairs, recipe.scale) for each in (bicubic, *networks)]
        row = "".join(f"{value:{width}.2f}" for value, width in zip(scores, (9, 10, 12), strict=True))
        sys.stdout.write(f"{kind:12s}{row}{scores[2] - scores[1]:8.2f}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
