"""Runs the whole benchmark: measures, and writes tables and figures."""

from __future__ import annotations

import csv
import json
import sys
import time
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from ciir.benchmarks import machine
from ciir.benchmarks.bench import figures, tables
from ciir.benchmarks.bench.methods import list_methods
from ciir.benchmarks.bench.results import average_rows, find_frontier, measure, replace_infinite
from ciir.benchmarks.bench.work import SCALE, list_works
from ciir.models.catalogue import picture_default_name
from ciir.renderer.scenes import SCENES
from ciir.service.pipeline.options import Options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ciir.service.pipeline.source import Source

LENSES = (25, 50, 100, 200)
ROUNDS = 11
CROP_COLUMNS = ("nearest", "bicubic", "paper", "fast-int8", "fast", "quality", "field-int8", "field")
EXPLANATION = """\
Milliseconds: medians over {rounds} round(s) in one warm process, each method once a round; decoding or rendering
(`backend`: what `auto` took), upscaling and PNG together. `upscale ms`: the network. `times faster than paper`: the
whole job against the same with the paper's generator in float onnxruntime. Errors are on Y over five views, PSNR in dB
and SSIM: of meshes against the view of a lens array with half the pitch, each pixel the mean of 4x4 rays over its own
cell; of light fields against the given views, which were halved to make the input. Arithmetic means over the inputs, of
PSNR without exact results; pareto.png has geometric means of times and root mean squares of errors.
"""


@dataclass(frozen=True)
class BenchOptions:
    """The inputs, arrays and number of rounds to measure."""

    sources: Mapping[str, Source] = field(default_factory=lambda: {name: name for name in SCENES})
    """Name -> scene, mesh, elemental image array or set of views."""
    lenses: Sequence[int] = LENSES
    """Lens counts of the arrays in front of a mesh."""
    array: Options = field(default_factory=Options)
    """How to read an elemental image array."""
    rounds: int = ROUNDS


QUICK = BenchOptions(sources={"globe": "globe"}, lenses=(25, 50), rounds=3)
"""The smoke test: one scene, two lens arrays, few rounds."""


def bench(options: BenchOptions, out: Path) -> dict[str, Any]:
    """Measures, writes `results.json`, `results.csv`, `results.md` and the figures into `out`, and returns the results.

    Raises the input errors of `ciir.errors`.
    """
    begun = time.perf_counter()
    methods, missing = list_methods()
    works = [
        work
        for name, source in options.sources.items()
        for work in list_works(source, name, lenses=options.lenses, array=options.array)
    ]
    results = [
        measure(work, methods, options.rounds) for work in tqdm(works, disable=None, unit="work", file=sys.stderr)
    ]
    rows = [row for result in results for row in result.rows]
    points = average_rows(rows)
    groups = dict.fromkeys((point.sampling, point.lenses) for point in points)
    frontier = {
        f"{lenses} lenses, {sampling}": [
            point.method for point in find_frontier(p for p in points if (p.sampling, p.lenses) == (sampling, lenses))
        ]
        for sampling, lenses in groups
    }
    here = machine.describe()
    found: dict[str, Any] = {
        "machine": here,
        "scale": SCALE,
        "rounds": options.rounds,
        "rows": rows,
        "points": [asdict(point) for point in points],
        "missing": missing,
        "frontier": frontier,
        "seconds": time.perf_counter() - begun,
    }
    out.mkdir(parents=True, exist_ok=True)
    name = f"{here['processor']}, {here['cores']} cores"
    figures.plot_pareto(points, out / "pareto.png", title=f"x{SCALE}; mean of {', '.join(options.sources)}; {name}")
    middle = sorted(result.work.lenses for result in results)[len(results) // 2]
    figures.plot_crops(
        [result for result in results if result.work.lenses == middle], out / "crops.png", methods=CROP_COLUMNS
    )
    with (out / "results.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    (out / "results.json").write_text(
        json.dumps(replace_infinite(found), indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    versions = ", ".join(f"{package} {version or 'absent'}" for package, version in here["versions"].items())
    lines = [
        f"Machine: {name}, {here['system']}. {versions}. The whole run took {found['seconds']:.0f} s.",
        "",
        "## One view, from bytes to PNG",
        "",
        EXPLANATION.format(rounds=options.rounds),
        *tables.format_results(rows),
        *(f"- `{method}`: left out: {why}" for method, why in missing.items()),
        "",
        "## On the frontier",
        "",
        *(_format_frontier(where, names) for where, names in frontier.items()),
    ]
    (out / "results.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return found


def _format_frontier(where: str, names: Sequence[str]) -> str:
    """Names the methods that no other beats in both time and error, and says whether the default is one of them."""
    note = "" if picture_default_name() in names else f" (not the default, `{picture_default_name()}`)"
    return f"- {where}: {', '.join(f'`{name}`' for name in names)}{note}"
