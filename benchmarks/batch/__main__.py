"""Measures `ciir batch`, each part alone or all of them:

    python -m ciir.benchmarks.batch [speed] [kills] [scale] [--arrays 200] [--meshes 50] [--tasks 100000] [-o DIR]

`speed`: two processes on two cores against one on one, in turn, and whether the pictures are equal. `kills`: workers
are killed every 5 s, and the scheduler once. `scale`: the scheduler's own time for each task, with 256 simulated
workers. Their tasks take the times that `speed` recorded, scaled to a mean of 100 ms.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from ciir.benchmarks.batch.inputs import write_inputs
from ciir.benchmarks.batch.kills import run_with_kills
from ciir.benchmarks.batch.simulation import simulate

LENSES, PIXELS, WORKERS = 100, 9, 256
OPTIONS = ["--lenses", f"{LENSES}x{LENSES}", "--pixels", f"{PIXELS}x{PIXELS}"]
PARTS = ("speed", "kills", "scale")
MEAN_SECONDS = 0.1


def main(argv: list[str] | None = None) -> None:
    """Prints the measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", default=PARTS)
    parser.add_argument("--arrays", type=int, default=200)
    parser.add_argument("--meshes", type=int, default=50)
    parser.add_argument("--tasks", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("-o", "--out", type=Path)
    args = parser.parse_args(argv)
    unknown = sorted(set(args.parts) - set(PARTS))
    if unknown:
        parser.error(f"{', '.join(unknown)}: not known; give some of {', '.join(PARTS)}")
    with tempfile.TemporaryDirectory(prefix="ciir-bench-") as folder:
        out = args.out or Path(folder)
        write_inputs(out / "in", args.arrays, args.meshes, LENSES, PIXELS)
        if "speed" in args.parts or not (out / "one" / "summary.json").exists():
            _measure_speed(out, args.rounds)
        if "kills" in args.parts:
            _measure_kills(out)
        if "scale" in args.parts:
            _measure_scale(out, args.tasks)


def _run(out: Path, name: str, workers: int) -> float:
    """Returns the seconds of a batch on as many cores as it has processes, with the scheduler and the command on them
    too.
    """
    shutil.rmtree(out / name, ignore_errors=True)
    begun = time.perf_counter()
    command = [sys.executable, "-m", "ciir", "batch", str(out / "in"), "-o", str(out / name), *OPTIONS]
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(cores)[:workers])  # child processes inherit this
    try:
        subprocess.run([*command, "--workers", str(workers)], check=True, stdout=subprocess.DEVNULL)
    finally:
        os.sched_setaffinity(0, cores)
    return time.perf_counter() - begun


def _measure_speed(out: Path, rounds: int) -> None:
    ratios = []
    for number in range(rounds):
        one, two = _run(out, "one", 1), _run(out, "two", 2)
        ratios.append(one / two)
        print(f"speed, round {number}: one process {one:.1f} s, two {two:.1f} s, {ratios[-1]:.2f} times", flush=True)
    print(f"speed: two processes {statistics.median(ratios):.2f} times one; {_compare(out, 'two')} pictures differ")


def _measure_kills(out: Path) -> None:
    shutil.rmtree(out / "killed", ignore_errors=True)
    found = run_with_kills(out / "in", out / "killed", OPTIONS)
    summary: dict[str, Any] = found.pop("summary")
    counts = {key: summary[key] for key in ("inputs", "done", "kept", "failed", "not_done", "seconds")}
    print(f"kills: {found | counts}; {_compare(out, 'killed')} pictures differ", flush=True)


def _measure_scale(out: Path, tasks: int) -> None:
    rows = json.loads((out / "one" / "summary.json").read_bytes())["results"]
    recorded = [row["seconds"] for row in rows if row["status"] == "done"]
    scale = MEAN_SECONDS / statistics.mean(recorded)
    found = simulate(tasks, WORKERS, [scale * length for length in recorded])
    print(f"scale: {found}")
    for seconds in (0.01, 0.1, 1.0):
        print(
            f"scale: one scheduler feeds {found.count_workers(seconds):,} workers with tasks of {1000 * seconds:g} ms"
        )


def _compare(out: Path, name: str) -> int:
    """Returns how many pictures of two runs differ, or exist in only one of them."""
    runs = [
        {path.relative_to(out / each): path.read_bytes() for path in (out / each).glob("*/*.png")}
        for each in ("one", name)
    ]
    return sum(runs[0].get(key) != runs[1].get(key) for key in runs[0].keys() | runs[1].keys())


if __name__ == "__main__":
    main()
