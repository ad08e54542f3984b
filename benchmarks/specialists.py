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

import torch
from torch import nn

from training import checkpoints, degrade, export, pictures, rendered, validation
from training.data import RENDERED
from training.loop import train
from training.networks.interpolation import Bicubic
from training.recipe import Recipe

SETS = Path("../shared/data/images")
UNSEEN = 999
"""Seed of the test's scenes; recipes have others."""
SCENES = 24


def tests(kind: str, scale: int) -> list[validation.Pair]:
    """Pairs `(LR, HR)` of degradation `kind`, `(h, w, 3)` 8 bit."""
    files = [path for name in ("Set5", "Set14") for path in sorted((SETS / name).glob("*_HR.png"))]
    photographs = [pictures.read_rgb(path) for path in files]
    if kind in RENDERED:
        which = RENDERED.index(kind)
        return [rendered.pairs(photographs, seed=UNSEEN, index=index)[which] for index in range(SCENES)]
    degraded = [degrade.pair(kind, torch.from_numpy(picture).permute(2, 0, 1), scale) for picture in photographs]
    return [(low.permute(1, 2, 0).numpy(), high.permute(1, 2, 0).numpy()) for low, high in degraded]


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
    recipe = Recipe(**{key: value for key, value in state["recipe"].items() if key != "averaged"})
    if recipe.scale != 2:
        parser.error(f"{given.checkpoint}: made for scale {recipe.scale}; scale 2 is what is tested here")
    given.out /= f"{recipe.name}-{state['commit'][:8]}-{state['step']}-{given.updates}"  # of these weights, no others
    sys.stdout.write(f"{'degradation':12s}{'bicubic':>9s}{recipe.name:>10s}{'specialist':>12s}{'behind':>8s}\n")
    bicubic = nn.Sequential(Bicubic(2), nn.PixelShuffle(2))
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
        networks = (bicubic, *(export.from_checkpoint(each) for each in (state, checkpoints.read(trained))))
        scores = [validation.validate(network, pairs, recipe.scale) for network in networks]
        row = "".join(f"{value:{width}.2f}" for value, width in zip(scores, (9, 10, 12), strict=True))
        sys.stdout.write(f"{kind:12s}{row}{scores[2] - scores[1]:8.2f}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
