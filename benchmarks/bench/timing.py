"""Times that can be compared: jobs take turns in one process, so that drift hits all alike."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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
    """The reference's time over this one's, median over rounds: how many times faster than the reference."""


def in_turns(
    jobs: Mapping[str, Callable[[], Stages]], rounds: int, *, reference: str = "", warm: bool = True
) -> dict[str, Times]:
    """Each job once in each of `rounds`, after one round that isn't counted where `warm`."""
    if warm:
        for job in jobs.values():
            job()
    runs: list[dict[str, Stages]] = [{name: job() for name, job in jobs.items()} for _ in range(rounds)]
    return {name: _of(name, runs, reference) for name in jobs}


def timed(work: Callable[[], object]) -> Stages:
    """One call as a job of `in_turns`."""
    begun = time.perf_counter()
    work()
    return {"total": 1e3 * (time.perf_counter() - begun)}


def _of(name: str, runs: list[dict[str, Stages]], reference: str) -> Times:
    totals = [run[name]["total"] for run in runs]
    low, middle, high = quartiles(totals)
    stages = {
        stage: statistics.median(run[name].get(stage, 0.0) for run in runs)
        for stage in runs[0][name]
        if stage != "total"
    }
    ratio = None
    if reference in runs[0]:
        ratio = statistics.median(run[reference]["total"] / run[name]["total"] for run in runs)
    return Times(middle, low, high, stages, ratio)


def quartiles(values: list[float]) -> tuple[float, float, float]:
    """First quartile, median, third quartile; of one value that value."""
    if len(values) == 1:
        return values[0], values[0], values[0]
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return low, middle, high


@dataclass(frozen=True)
class Alone:
    """A job in a process of its own."""

    cold_ms: float
    """From the start of the process to its end, all imports and the reading of the network included."""
    peak_mib: float | None
    """Most resident memory of that process; None where the system doesn't tell."""


def alone(source: str, options: Mapping[str, Any]) -> Alone:
    """`reconstruct` of `source`, `scene:NAME` or a path, in a new process. Raises `RuntimeError` where it fails."""
    task = json.dumps({"source": source, "options": dict(options)})
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "ciir.benchmarks.bench.timing", task], capture_output=True, text=True, check=False
    )
    cold = 1e3 * (time.perf_counter() - begun)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise RuntimeError(f"{source} in a process of its own: {last[:200]}")
    return Alone(cold, json.loads(done.stdout)["peak_mib"])


def peak_mib() -> float | None:
    """Most resident memory of this process so far, in MiB; `getrusage` would count the parent's too."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:  # noqa: PTH123 - no file on a disk
            lines = dict(line.split(":", 1) for line in status)
        return int(lines["VmHWM"].split()[0]) / 1024
    except (OSError, KeyError):
        return None


def _child(task: dict[str, Any]) -> None:
    import io

    from ciir.renderer.writers.formats import FileWriter
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.run import reconstruct
    from ciir.service.pipeline.source import open_source

    given: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value for key, value in task["options"].items()
    }
    reconstruct(open_source(task["source"]), Options(**given), FileWriter(io.BytesIO(), None))
    print(json.dumps({"peak_mib": peak_mib()}))


if __name__ == "__main__":
    _child(json.loads(sys.argv[1]))
