"""Measurements: a row of numbers for each piece of work and method, their means, and the frontier."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.benchmarks.bench.errors import compare
from ciir.benchmarks.bench.methods import DIRECT, PAPER
from ciir.benchmarks.bench.timing import time_in_rounds

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from ciir.benchmarks.bench.methods import Method
    from ciir.benchmarks.bench.work import Work

    Row = dict[str, Any]

STAGES = ("decode", "render", "map", "upscale", "encode")
NUMBERS = (
    *(f"ms_{name}" for name in ("median", "low", "high", *STAGES)),
    "times_faster_than_paper",
    *(f"{name}_{where}" for where in ("all", "object") for name in ("rmse", "psnr", "ssim")),
)
"""Columns of a row; None if a method failed, or if there is no object."""


@dataclass(eq=False)
class Result:
    """One piece of work by every method that suits it."""

    work: Work
    pictures: dict[str, NDArray[np.uint8]]
    """Method -> the views, `(n, H, W, 3)`."""
    rows: list[Row]


@dataclass(frozen=True)
class Point:
    """A method at one sampling and lens array, over all inputs."""

    method: str
    kind: str
    sampling: str
    lenses: str
    milliseconds: float
    """Geometric mean of the inputs' medians."""
    rmse: float
    """Root of the mean square over the inputs, in levels."""


def measure(work: Work, methods: Sequence[Method], rounds: int) -> Result:
    """Measures pictures, errors and times of each method; the row of one that fails holds its `error`."""
    pictures: dict[str, NDArray[np.uint8]] = {}
    rows: dict[str, Row] = {}
    suited = [method for method in methods if method.suits(work)]
    for method in suited:
        macs = method.macs_per_output_pixel
        row = rows[method.name] = {
            "input": work.name,
            "lenses": "{}x{}".format(*work.lenses),
            "sampling": work.sampling,
            "method": method.name,
            "kind": method.kind,
            "backend": None,
            "error": "",
            "gmacs": None if macs is None else macs * 4 * work.lenses[0] * work.lenses[1] / 1e9,
        } | dict.fromkeys(NUMBERS)
        try:
            views, row["backend"] = method.reconstruct(work)
        except Exception as error:  # noqa: BLE001 - any error is printed in place of the numbers
            row["error"] = f"{type(error).__name__}: {error}"
            continue
        pictures[method.name] = views
        row |= {f"{name}_all": value for name, value in asdict(compare(views, work.truth)).items()}
        if work.object is not None and work.object.any():
            errors = asdict(compare(views, work.truth, work.object))
            row |= {f"{name}_object": value for name, value in errors.items()}
    jobs = {method.name: partial(method.time_job, work) for method in suited if method.name in pictures}
    for name, times in time_in_rounds(jobs, rounds, reference=PAPER).items():
        rows[name] |= {"ms_median": times.median, "ms_low": times.low, "ms_high": times.high}
        rows[name] |= {f"ms_{stage}": times.stages.get(stage) for stage in STAGES}
        rows[name]["times_faster_than_paper"] = times.ratio
    return Result(work, pictures, list(rows.values()))


def group_rows(rows: Iterable[Row]) -> dict[tuple[str, str], dict[str, list[Row]]]:
    """Groups rows by (sampling, lenses), then by method, with one row for each input; small lens arrays come first."""
    groups: dict[tuple[str, str], dict[str, list[Row]]] = {}
    for row in sorted(rows, key=lambda row: (row["sampling"], int(row["lenses"].partition("x")[0]))):
        groups.setdefault((row["sampling"], row["lenses"]), {}).setdefault(row["method"], []).append(row)
    return groups


def average_rows(rows: Iterable[Row]) -> list[Point]:
    """Returns means over inputs, for each sampling, lens array and method that failed on none of them."""
    found = []
    for (sampling, lenses), methods in group_rows(rows).items():
        for method, some in methods.items():
            if not any(row["error"] for row in some):
                time = float(np.exp(np.mean(np.log([row["ms_median"] for row in some]))))
                rmse = float(np.sqrt(np.mean(np.square([row["rmse_all"] for row in some]))))
                found.append(Point(method, some[0]["kind"], sampling, lenses, time, rmse))
    return found


def find_frontier(points: Iterable[Point]) -> list[Point]:
    """Returns the methods that no other beats in both time and error, fastest first.

    Direct rendering is left out, because it needs the mesh, and with the mesh there is nothing to upscale.
    """
    best: list[Point] = []
    for point in sorted(points, key=lambda point: (point.milliseconds, point.rmse)):
        if point.kind != DIRECT and (not best or point.rmse < best[-1].rmse):
            best.append(point)
    return best


def replace_infinite(value: Any) -> Any:
    """Replaces infinity and NaN, which JSON lacks, by the strings `inf`, `-inf` and `nan`."""
    if isinstance(value, dict):
        return {key: replace_infinite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [replace_infinite(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
