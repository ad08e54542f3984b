"""What came out: for each piece of work, each method's pictures, errors and times."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.benchmarks.bench.errors import Error, compare
from ciir.benchmarks.bench.methods import PAPER
from ciir.benchmarks.bench.timing import Times, in_turns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.benchmarks.bench.methods import Method
    from ciir.benchmarks.bench.work import Work


@dataclass(eq=False)
class Result:
    """One piece of work by every method that could do it."""

    work: Work
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    errors: dict[str, Error] = field(default_factory=dict)
    """On all pixels."""
    on_object: dict[str, Error] = field(default_factory=dict)
    """On the object alone; empty where there is none."""
    times: dict[str, Times] = field(default_factory=dict)
    backends: dict[str, str | None] = field(default_factory=dict)
    """What rendered the mesh; None where nothing did."""
    faults: dict[str, str] = field(default_factory=dict)
    """Method -> why it has no result."""


@dataclass(frozen=True)
class Point:
    """A method at one sampling and count of lenses, over all scenes."""

    method: str
    kind: str
    sampling: str
    lenses: int
    milliseconds: float
    """Geometric mean of the scenes' medians."""
    rmse: float
    """Levels; root of the mean square over the scenes."""


def measured(work: Work, methods: Sequence[Method], rounds: int) -> Result:
    """Pictures, errors and times of each method; one that fails is named in `faults`, with what it said."""
    result = Result(work)
    able: list[Method] = []
    for method in methods:
        if not method.suits(work):
            continue
        try:
            made, backend = method.made(work)
        except Exception as fault:  # noqa: BLE001 - whatever it is, it is printed in the place of the result
            result.faults[method.name] = f"{type(fault).__name__}: {fault}"
            continue
        able.append(method)
        result.pictures[method.name] = made
        result.errors[method.name] = compare(made, work.truth)
        if work.object is not None and work.object.any():
            result.on_object[method.name] = compare(made, work.truth, work.object)
        result.backends[method.name] = backend
    jobs = {method.name: partial(method.job, work) for method in able}
    result.times = in_turns(jobs, rounds, reference=PAPER)
    return result


def points(results: Sequence[Result], methods: Sequence[Method]) -> list[Point]:
    """Means over scenes, for each sampling, count of lenses and method."""
    found = []
    for sampling in sorted({result.work.sampling for result in results}):
        for lenses in sorted({result.work.lenses[0] for result in results}):
            here = [r for r in results if r.work.sampling == sampling and r.work.lenses[0] == lenses]
            for method in methods:
                some = [result for result in here if method.name in result.times]
                if some and len(some) == len(here):  # a mean without the scenes that failed would flatter
                    times = [math.log(result.times[method.name].median) for result in some]
                    errors = [result.errors[method.name].rmse ** 2 for result in some]
                    time, rmse = math.exp(float(np.mean(times))), float(np.mean(errors)) ** 0.5
                    found.append(Point(method.name, method.kind, sampling, lenses, time, rmse))
    return found


def as_rows(results: Sequence[Result], methods: Sequence[Method]) -> list[dict[str, Any]]:
    """A flat row for each work and method, for CSV and JSON; None where nothing was computed, with `fault`."""
    rows = []
    for result in results:
        work = result.work
        for method in methods:
            if not method.suits(work):
                continue
            row: dict[str, Any] = {
                "input": work.name,
                "lenses": f"{work.lenses[0]}x{work.lenses[1]}",
                "sampling": work.sampling,
                "method": method.name,
                "kind": method.kind,
                "backend": result.backends.get(method.name),
                "gmacs": None
                if method.macs_per_output_pixel is None
                else method.macs_per_output_pixel * 4 * work.lenses[0] * work.lenses[1] / 1e9,
                "fault": result.faults.get(method.name, ""),
            }
            times = result.times.get(method.name)
            for name in ("median", "low", "high", "ratio"):
                key = "times_faster_than_paper" if name == "ratio" else f"ms_{name}"
                row[key] = getattr(times, name) if times is not None else None
            for stage in ("decode", "render", "map", "upscale", "encode"):
                row[f"ms_{stage}"] = times.stages.get(stage) if times is not None else None
            for where, errors in (("all", result.errors), ("object", result.on_object)):
                for name in ("rmse", "psnr", "ssim", "gradient", "gradient_worst"):
                    error = errors.get(method.name)
                    row[f"{name}_{where}"] = getattr(error, name) if error is not None else None
            rows.append(row)
    return rows
