"""How long the main job takes, warm, end to end: what a user waits for.

    python -m benchmarks.main_path [--mesh FILE] [--rounds 15] [--json FILE]

Each row is one whole job from bytes in memory to encoded PNG bytes, with the sessions and the rendering context open,
except `ciir models`, which is a whole process from a cold start. Rows take turns, so that drift hits all alike.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models import catalogue
from renderer.bundle import Bundle
from renderer.pictures import encode_png
from service.outputs import FileSink
from service.pipeline import elemental, reconstruct
from service.request import Options

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from service.source import Source

LENSES, PIXELS = (50, 50), (15, 15)


def one_view(source: Source, **options: Any) -> Callable[[], Mapping[str, float]]:
    """The centre view of 50x50 lenses, doubled, as PNG; returns the report's timings."""
    wanted = Options(lenses=LENSES, pixels=PIXELS, **options)
    return lambda: reconstruct(source, wanted, FileSink(io.BytesIO(), None))["timings_ms"]


def whole_array(source: Source, **options: Any) -> Callable[[], Mapping[str, float]]:
    """The elemental image array of 50x50 lenses of 15x15 pixels as PNG; returns the report's timings."""
    wanted = Options(lenses=LENSES, pixels=PIXELS, **options)
    return lambda: elemental(source, wanted, encode_png)["timings_ms"]


def list_models() -> Mapping[str, float]:
    """`ciir models`, a whole process."""
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-m", "service.cli", "models"], check=True, stdout=subprocess.DEVNULL)
    return {"total": 1000 * (time.perf_counter() - begun)}


def main(argv: list[str] | None = None) -> int:
    """Prints the table; `--json` writes every single time."""
    parser = argparse.ArgumentParser(prog="benchmarks.main_path", description=main.__doc__)
    parser.add_argument("--mesh", type=Path, help="mesh file (default: the shipped hamburger)")
    parser.add_argument("--rounds", type=int, default=15, help="times that each row runs (default 15)")
    parser.add_argument("--json", type=Path, help="file for all times, milliseconds")
    given = parser.parse_args(argv)
    source: Source = Bundle.from_path(given.mesh) if given.mesh else "hamburger"
    rows: dict[str, Callable[[], Mapping[str, float]]] = {
        f"{backend}: view 50x50 -> 100x100, {model}": one_view(source, backend=backend, model=model)
        for backend in ("raster", "raytrace")
        for model in (catalogue.default(), "bicubic")
    }
    for backend in ("raster", "raytrace"):
        rows[f"{backend}: view 100x100 directly"] = one_view(source, backend=backend, strategy="direct")
        rows[f"{backend}: EIA 50x50 lenses of 15x15"] = whole_array(source, backend=backend)
    rows["ciir models, cold start"] = list_models
    for job in rows.values():
        job()
    times: dict[str, list[Mapping[str, float]]] = {name: [] for name in rows}
    for _ in range(given.rounds):
        for name, job in rows.items():
            times[name].append(job())
    name = source.name if isinstance(source, Bundle) else source
    sys.stdout.write(f"{name}, {os.cpu_count()} cores, {given.rounds} rounds; milliseconds, medians\n")
    for row, runs in times.items():
        totals = sorted(run["total"] for run in runs)
        stages = {stage: statistics.median(run[stage] for run in runs) for stage in runs[0] if stage != "total"}
        detail = "  ".join(f"{stage} {value:.1f}" for stage, value in stages.items())
        sys.stdout.write(
            f"{row:42s} {statistics.median(totals):8.1f}  (from {totals[0]:.1f} to {totals[-1]:.1f})  {detail}\n"
        )
    if given.json:
        given.json.write_text(json.dumps(times, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
