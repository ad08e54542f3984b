"""Compares `--strategy auto` with both fixed strategies, and its predictions with measured times.

    python -m ciir.benchmarks.planning [--rounds 5] [--lenses 25 50 100 200] [--mesh FILE ...] [--json FILE]

It runs whole jobs from bytes or scene to a zip of PNGs in memory, warm, each strategy once a round: upscale, direct,
auto. There is a row for each mesh, lens count, sampling and set of views. It gives the quickest of all rounds, the
strategy that `auto` took and what it predicted, and how much slower `auto` is than the better fixed strategy in the
same round (median). `!` marks more than 15 %. The last lines sum up: the worst row, what always taking one strategy
would cost in its worst row, and predictions relative to measured times.
"""

from __future__ import annotations

import argparse
import io
import itertools
import json
import statistics
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ciir.benchmarks.bench.work import SAMPLINGS
from ciir.benchmarks.machine import describe
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scenes import SCENES
from ciir.renderer.writers.formats import FileWriter
from ciir.service.pipeline.options import Options, Strategy
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

LENSES = (25, 50, 100, 200)
VIEWS = ("center", "cross", "all")
STRATEGIES = get_args(Strategy)
SLOWER = 0.15
"""How much slower than the better fixed strategy `auto` may be."""


def main(argv: list[str] | None = None) -> int:
    """Prints the table; `--json` writes every time. Returns 1 if `auto` was too slow."""
    parser = argparse.ArgumentParser(prog="benchmarks.planning", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="times that each job runs (default 5)")
    parser.add_argument("--lenses", type=int, nargs="+", default=LENSES, help="lens counts N of arrays N x N")
    parser.add_argument("--views", nargs="+", default=VIEWS, help="sets of views (default: center cross all)")
    parser.add_argument("--mesh", type=Path, nargs="+", default=[], help="mesh files in addition to the shipped scenes")
    parser.add_argument("--json", type=Path, help="file for all rows, milliseconds")
    args = parser.parse_args(argv)
    sources: dict[str, Source] = {name: name for name in SCENES}
    sources |= {path.stem: Bundle.from_path(path) for path in args.mesh}
    print("mesh         lenses  sampling views    upscale    direct      auto  took     predicted  slower")
    rows = []
    for mesh, lenses, sampling, views in itertools.product(sources, args.lenses, SAMPLINGS, args.views):
        options = {"lenses": (lenses, lenses), "sampling": sampling, "views": views, "neighbour_time": 0.0}
        row = {"mesh": mesh, "lenses": lenses, "sampling": sampling, "views": views}
        rows.append(row | measure(sources[mesh], options, args.rounds))
        print(format_row(rows[-1]), flush=True)
    worst = max(rows, key=compute_slowdown)
    print(f"auto: at worst {100 * compute_slowdown(worst):.0f} % slower than the better one ({worst['mesh']})")
    for strategy in ("upscale", "direct"):
        ratio = max(row[strategy] / min(row["upscale"], row["direct"]) for row in rows)
        print(f"always {strategy}: at worst {ratio:.1f} times the better one")
    ratios = sorted(row["predicted"] / row["auto"] for row in rows)
    print(f"predicted / measured: {statistics.median(ratios):.2f} (from {ratios[0]:.2f} to {ratios[-1]:.2f})")
    if args.json:
        args.json.write_text(json.dumps({"machine": describe(), "rows": rows}, indent=1))
    return int(compute_slowdown(worst) > SLOWER)


def measure(source: Source, options: dict[str, Any], rounds: int) -> dict[str, Any]:
    """Measures all `rounds` by strategy in milliseconds, after one that is not counted.

    Returns the quickest, all counted times, and the plan of `auto`.
    """
    times: dict[str, list[float]] = {strategy: [] for strategy in STRATEGIES}
    report: Report = {}
    for _ in range(rounds + 1):
        for strategy in STRATEGIES:
            begun = time.perf_counter()
            with FileWriter(io.BytesIO(), "zip") as writer:
                report = reconstruct(source, Options(**options, strategy=strategy), writer)
            times[strategy].append(1000 * (time.perf_counter() - begun))
            if strategy == "auto":
                plan = report["plan"]
    (reason,) = [text for text in plan["reasons"] if " ms here" in text]
    predicted = float(reason.partition(" ms here")[0].rpartition(" ")[2])
    counted = {strategy: taken[1:] for strategy, taken in times.items()}
    best = {strategy: min(taken) for strategy, taken in counted.items()}
    return best | {"took": plan["strategy"], "predicted": predicted, "rounds": counted}


def compute_slowdown(row: dict[str, Any]) -> float:
    """Returns how much slower `auto` is than the better fixed strategy: the median of the ratios within rounds, minus
    1.
    """
    best = min(("upscale", "direct"), key=row.__getitem__)
    ratios = [auto / fixed for auto, fixed in zip(row["rounds"]["auto"], row["rounds"][best], strict=True)]
    return float(statistics.median(ratios)) - 1


def format_row(row: dict[str, Any]) -> str:
    """Formats a row of the table."""
    mark = " !" if compute_slowdown(row) > SLOWER else ""
    return (
        f"{row['mesh']:12s} {row['lenses']:6d}  {row['sampling']:8s} {row['views']:6s} {row['upscale']:10.1f}"
        f"{row['direct']:10.1f}{row['auto']:10.1f}  {row['took']:8s} {row['predicted']:9.1f}"
        f"{100 * compute_slowdown(row):6.0f} %{mark}"
    )


if __name__ == "__main__":
    sys.exit(main())
