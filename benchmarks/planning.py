"""`--strategy auto` held against both fixed strategies, and what it predicts against what was measured.

    python -m ciir.benchmarks.planning [--rounds 5] [--lenses 25 50 100 200] [--mesh FILE ...] [--json FILE]

Whole jobs from bytes or scene to a zip of PNGs in memory, warm, taking turns in one process: upscale, direct, auto. A
row for each mesh, lens count, sampling and choice of views: the quickest of all rounds, the strategy that `auto` took
with what it predicted, and by how much it is slower than the best fixed one in the same round (median). `!` marks more
than 15 %. The lines below sum up: the worst of all, what always taking one strategy would have cost in its worst row,
and how far predictions were off.

Then rows as above of whole `ciir reconstruct` commands for one view of a scene.
"""

from __future__ import annotations

import argparse
import io
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ciir.benchmarks.machine import describe
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scenes import SCENES
from ciir.renderer.writers.formats import FileWriter
from ciir.service.pipeline.options import Options, Strategy
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

LENSES = (25, 50, 100, 200)
VIEWS = ("center", "cross", "all")
SAMPLINGS = ("pinhole", "lenslet")
STRATEGIES = get_args(Strategy)
SLOWER = 0.15
"""By how much `auto` may be slower than the best fixed strategy."""


def main(argv: list[str] | None = None) -> int:
    """Prints the tables; `--json` writes every time. Returns 1 where `auto` was too slow."""
    parser = argparse.ArgumentParser(prog="benchmarks.planning", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="times that each job runs (default 5)")
    parser.add_argument("--lenses", type=int, nargs="+", default=LENSES, help="of arrays N x N")
    parser.add_argument("--views", nargs="+", default=VIEWS, help="choices of views (default: center cross all)")
    parser.add_argument("--mesh", type=Path, nargs="+", default=[], help="mesh files beside the shipped scenes")
    parser.add_argument("--json", type=Path, help="file for all rows, milliseconds")
    given = parser.parse_args(argv)
    sources: dict[str, Source] = dict(zip(SCENES, SCENES, strict=True))
    sources |= {path.stem: Bundle.from_path(path) for path in given.mesh}
    machine = describe()
    sys.stdout.write(f"{machine['processor']}, {machine['cores']} cores, {given.rounds} rounds; milliseconds\n")
    sys.stdout.write("mesh         lenses  sampling views    upscale    direct      auto  took     predicted  slower\n")
    rows = []
    for row in _rows(sources, given.lenses, given.views, given.rounds):
        rows.append(row)
        sys.stdout.write(line(row))
        sys.stdout.flush()
    worst = max(rows, key=slower)
    sys.stdout.write(f"auto: {100 * slower(worst):.0f} % slower than the best at worst ({worst['mesh']})\n")
    for strategy in STRATEGIES[:2]:
        ratio = max(row[strategy] / min(row["upscale"], row["direct"]) for row in rows)
        sys.stdout.write(f"always {strategy}: {ratio:.1f} times the best at worst\n")
    off = sorted(row["predicted"] / row["auto"] for row in rows)
    sys.stdout.write(f"predicted / measured: {statistics.median(off):.2f} (from {off[0]:.2f} to {off[-1]:.2f})\n")
    for row in _cold_rows(given.lenses, given.rounds):
        rows.append(row)
        sys.stdout.write(line(row))
        sys.stdout.flush()
    worst = max(rows, key=slower)
    if given.json:
        given.json.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1))
    return int(slower(worst) > SLOWER)


def slower(row: dict[str, Any]) -> float:
    """By how much `auto` is slower than the best fixed strategy: the median of rounds, each by itself."""
    rounds = row["rounds"]
    best = min(("upscale", "direct"), key=row.__getitem__)
    ratios = [auto / fixed for auto, fixed in zip(rounds["auto"], rounds[best], strict=True)]
    return float(statistics.median(ratios)) - 1


def whole_process(options: Sequence[str]) -> float:
    """Milliseconds of a process of `ciir reconstruct`, from its start to its end."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "ciir", "reconstruct", *options, "-o", str(Path(folder) / "out.zip")]
        begun = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return 1000 * (time.perf_counter() - begun)


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    mark = " !" if slower(row) > SLOWER else ""
    predicted = "" if row["predicted"] is None else f"{row['predicted']:.1f}"
    return (
        f"{row['mesh']:12s} {row['lenses']:6d}  {row['sampling']:8s} {row['views']:6s} {row['upscale']:10.1f}"
        f"{row['direct']:10.1f}{row['auto']:10.1f}  {row['took']:8s} {predicted:>9s} {100 * slower(row):6.0f} %"
        f"{mark}\n"
    )


def _rows(
    sources: dict[str, Source], lenses: Sequence[int], views: Sequence[str], rounds: int
) -> Iterator[dict[str, Any]]:
    for name, source in sources.items():
        for count in lenses:
            for sampling in SAMPLINGS:
                for chosen in views:
                    asked = {"lenses": (count, count), "sampling": sampling, "views": chosen}
                    row = {"mesh": name, "lenses": count, "sampling": sampling, "views": chosen}
                    yield row | _measured(source, asked, rounds)


def _measured(source: Source, asked: dict[str, Any], rounds: int) -> dict[str, Any]:
    """The quickest of `rounds` by strategy, after one that warms up, and what `auto` said."""
    times: dict[str, list[float]] = {strategy: [] for strategy in STRATEGIES}
    report: Report = {}
    for _ in range(rounds + 1):
        for strategy in STRATEGIES:
            begun = time.perf_counter()
            with FileWriter(io.BytesIO(), "zip") as writer:
                report = reconstruct(source, Options(**asked, strategy=strategy), writer)
            times[strategy].append(1000 * (time.perf_counter() - begun))
    took = report["plan"]["strategy"]
    (reason,) = [text for text in report["plan"]["reasons"] if " ms here" in text]
    predicted = float(reason.partition(" ms here")[0].rpartition(" ")[2])
    rounds_of = {strategy: taken[1:] for strategy, taken in times.items()}
    best = {strategy: min(taken) for strategy, taken in rounds_of.items()}
    return best | {"took": took, "predicted": predicted, "rounds": rounds_of}


def _cold_rows(lenses: Sequence[int], rounds: int) -> Iterator[dict[str, Any]]:
    """Rows of whole processes, one view each; which strategy `auto` takes there is not looked at."""
    for name in SCENES:
        for count in lenses:
            row = {"mesh": name, "lenses": count, "sampling": "cold", "views": "center"}
            asked = [f"scene:{name}", "--lenses", f"{count}x{count}"]
            of = {strategy: [*asked, "--strategy", strategy] for strategy in STRATEGIES}
            turns = [{strategy: whole_process(of[strategy]) for strategy in STRATEGIES} for _ in range(rounds)]
            taken = {strategy: [turn[strategy] for turn in turns] for strategy in STRATEGIES}
            best = {strategy: min(times) for strategy, times in taken.items()}
            yield row | best | {"took": "", "predicted": None, "rounds": taken}


if __name__ == "__main__":
    sys.exit(main())
