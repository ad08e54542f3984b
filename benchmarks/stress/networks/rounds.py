"""Upscales by 2, takes the mean of each 2x2, and repeats: 50 rounds must neither drift nor ring."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.networks import patterns
from ciir.benchmarks.stress.networks.shipped import LEVEL, downsample, find_worst
from ciir.models import catalogue

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort, Found
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 48
ROUNDS = 50
DRIFT = 10.0
"""How many levels the mean may have moved after all rounds: a fifth of a level a round."""
RINGING = 1.05**50
"""How many times as large the total variation may become, 11.5: 5 % a round, 50 times over. A round sharpens a little,
because networks learn to undo a coarser sampling than the mean of 2x2, and the next round sharpens the result again."""
DRIFT_KNOWN = {"paper": 40.0}
"""The paper's network drifts. It ships for comparison."""


def rounds(effort: Effort) -> Iterator[Found]:
    """Upscales pictures and averages them down again and again, and measures their mean level and total variation."""
    inputs = patterns.make_pictures(SIDE)
    first = np.stack(list(inputs.values()))
    count = 10 if effort.quick else ROUNDS
    for name in effort.models:
        model, images = catalogue.load_upscaler(name), first
        drift, ringing = [], []
        for _ in range(count):
            images = downsample(model(images))
            drift.append(np.abs(images.mean(axis=(1, 2, 3)) - first.mean(axis=(1, 2, 3))) / LEVEL)
            ringing.append(compute_variation(images) / compute_variation(first))
        bound, what = DRIFT_KNOWN.get(name, DRIFT), f"{name}: drift of the mean over {count} rounds, levels"
        yield find_worst(what, bound, np.max(drift, axis=0), list(inputs))
        what = f"{name}: growth of total variation over {count} rounds"
        yield find_worst(what, RINGING, np.max(ringing, axis=0), list(inputs))


def compute_variation(images: Values) -> Values:
    """Returns each picture's mean absolute difference of neighbours, down and across: `(N, C, H, W)` -> `(N,)`."""
    sums = [np.abs(np.diff(images, axis=axis)).mean(axis=(1, 2, 3)) for axis in (2, 3)]
    return np.asarray(sums[0] + sums[1])


CASES: tuple[Case, ...] = (rounds,)
