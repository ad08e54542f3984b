"""Times jobs that run in turn in one process, so that a slower or faster machine affects all alike."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

Stages = dict[str, float]
"""Milliseconds of each stage, and `total`."""


@dataclass(frozen=True)
class Times:
    """Milliseconds over all rounds."""

    median: float
    low: float
    """The first quartile."""
    high: float
    """The third quartile."""
    stages: Mapping[str, float]
    """Median of each stage."""
    ratio: float | None = None
    """The reference's time divided by this one's, median over rounds: how many times faster than the reference."""


def time_in_rounds(jobs: Mapping[str, Callable[[], Stages]], rounds: int, *, reference: str = "") -> dict[str, Times]:
    """Runs each job once in each of `rounds`, after one round that is not counted."""
    runs = [{name: job() for name, job in jobs.items()} for _ in range(rounds + 1)][1:]
    return {name: _summarise(name, runs, reference) for name in jobs}


def time_call(work: Callable[[], object]) -> Stages:
    """Calls `work` once, as a job of `time_in_rounds`.

    Returns its wall-clock time and, as stage `cpu`, the processor time of this process and of those that it waited for.
    """
    begun, worked = time.perf_counter(), sum(os.times()[:4])
    work()
    return {"total": 1e3 * (time.perf_counter() - begun), "cpu": 1e3 * (sum(os.times()[:4]) - worked)}


def _summarise(name: str, runs: list[dict[str, Stages]], reference: str) -> Times:
    totals = np.array([run[name]["total"] for run in runs])
    low, median, high = np.quantile(totals, [0.25, 0.5, 0.75]).tolist()
    stages = [stage for stage in runs[0][name] if stage != "total"]
    medians = {stage: float(np.median([run[name].get(stage, 0.0) for run in runs])) for stage in stages}
    ratio = None
    if reference in runs[0]:
        ratio = float(np.median([run[reference]["total"] / run[name]["total"] for run in runs]))
    return Times(median, low, high, medians, ratio)
