"""The whole benchmark: measures, and writes tables and pictures."""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from ciir.benchmarks import machine
from ciir.benchmarks.bench import arrays, figures, growth, inference, tables
from ciir.benchmarks.bench.methods import Method, methods
from ciir.benchmarks.bench.results import Result, as_rows, measured, points
from ciir.benchmarks.bench.timing import Alone, alone
from ciir.benchmarks.bench.work import PIXELS, SAMPLINGS, SCALE, works
from ciir.models.catalogue import DEFAULT, default_name
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import SCENES
from ciir.service.pipeline.options import Options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ciir.benchmarks.bench.work import Work
    from ciir.service.pipeline.options import Sampling
    from ciir.service.pipeline.source import Source

LENSES = (25, 50, 100, 200)
ROUNDS = 11
CROP_COLUMNS = ("nearest", "bicubic", "paper", "fast-int8", "fast", "quality", "gan")


@dataclass(frozen=True)
class Asked:
    """What to measure."""

    sources: Mapping[str, Source] = field(default_factory=lambda: {name: name for name in SCENES})
    """Name -> scene, mesh, elemental image array or set of views."""
    places: Mapping[str, str] = field(default_factory=lambda: {name: f"scene:{name}" for name in SCENES})
    """Name -> what a process of its own opens it by."""
    lenses: Sequence[int] = LENSES
    """Of the arrays in front of a mesh."""
    samplings: Sequence[Sampling] = SAMPLINGS
    array: Options = field(default_factory=Options)
    """What reads an elemental image array."""
    rounds: int = ROUNDS
    extras: bool = True
    """Whether elemental image arrays, engines and growth are measured too."""
    quick: bool = False


def quick() -> Asked:
    """The smoke test: one scene, two lens arrays, few rounds."""
    return Asked(sources={"globe": "globe"}, places={"globe": "scene:globe"}, lenses=(25, 50), rounds=3, quick=True)


def bench(asked: Asked, out: Path) -> dict[str, Any]:
    """Measures, writes `results.json`, `results.csv`, `results.md` and the pictures into `out`; returns the results.

    Raises the input faults of `ciir.errors`.
    """
    begun = time.perf_counter()
    every, missing = methods()
    results = _main(asked, every)
    found: dict[str, Any] = {
        "machine": machine.describe(),
        "scale": SCALE,
        "rounds": asked.rounds,
        "quick": asked.quick,
    }
    rows = as_rows(results, every)
    lines = _heading(found)
    lines += ["## One view, from bytes to PNG", "", _explained(asked, [result.work for result in results]), ""]
    lines += tables.main_tables(rows, {method.name: method.what for method in every})
    lines += [f"- `{name}`: left out: {why}" for name, why in missing.items()]
    own = _alone(asked, every, results)
    if own:
        lines += ["", "## In a process of its own", "", OWN, "", *tables.alone_table(own)]
    means = points(results, every)
    out.mkdir(parents=True, exist_ok=True)
    title = f"x{SCALE} from the views of a lens array; mean of {', '.join(asked.sources)}; {_machine(found)}"
    figures.pareto(means, out / "pareto.png", title=title)
    middle = sorted({result.work.lenses[0] for result in results})
    figures.crops(results, out / "crops.png", lenses=middle[len(middle) // 2], methods=CROP_COLUMNS)
    found |= {"rows": rows, "points": [asdict(point) for point in means], "missing": missing}
    found["frontier"] = _frontiers(means)
    lines += ["## On the frontier", "", *_frontier_lines(found["frontier"]), ""]
    found["alone"] = {
        lenses: {method: got if isinstance(got, str) else asdict(got) for method, got in of.items()}
        for lenses, of in own.items()
    }
    if asked.extras:
        lines += _extras(asked, every, found, out)
    found["seconds"] = time.perf_counter() - begun
    lines += [f"The whole run took {found['seconds']:.0f} s."]
    tables.write_csv(rows, out / "results.csv")
    (out / "results.json").write_text(json.dumps(_finite(found), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (out / "results.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return found


def _main(asked: Asked, every: Sequence[Method]) -> list[Result]:
    todo = [
        work
        for name, source in asked.sources.items()
        for work in works(source, name, lenses=asked.lenses, samplings=asked.samplings, array=asked.array)
    ]
    bar = tqdm(todo, disable=None, unit="work", desc="views", file=sys.stderr)
    return [measured(work, every, asked.rounds) for work in bar]


def _alone(asked: Asked, every: Sequence[Method], results: Sequence[Result]) -> dict[str, dict[str, Alone | str]]:
    """Of the first mesh, lenslets; a light field at half its resolution is no file that another process could open."""
    works_ = [r.work for r in results if r.work.kind == "mesh"]
    works_ = [work for work in works_ if work.name == works_[0].name and work.sampling == asked.samplings[-1]]
    works_ = works_[-1:] if asked.quick else works_
    found: dict[str, dict[str, Alone | str]] = {}
    for work in tqdm(works_, disable=None, unit="array", desc="processes", file=sys.stderr):
        of = found.setdefault(f"{work.name}, {work.lenses[0]}x{work.lenses[1]}", {})
        for method in every:
            options = {
                "lenses": work.lenses,
                "pixels": work.options.pixels,
                "sampling": work.sampling,
                **method.options,
            }
            try:
                of[method.name] = alone(asked.places[work.name], options)
            except RuntimeError as fault:
                of[method.name] = str(fault)
    return found


def _extras(asked: Asked, every: Sequence[Method], found: dict[str, Any], out: Path) -> list[str]:
    array = LensArray(25, 25, 9, 9) if asked.quick else LensArray(50, 50, *PIXELS)
    networks = [method.name for method in every if method.kind in ("float network", "int8 network")]
    routes, without = arrays.routes("hamburger", array, Options(), min(3, asked.rounds))
    found["arrays"] = [asdict(route) for route in routes]
    what = f"{array.rows}x{array.cols} lenses of {array.pixels_v}x{array.pixels_u} pixels, scene:hamburger"
    lines = ["## Elemental image arrays", "", f"{what}; the scene is new to the backend each time.", ""]
    lines += tables.routes_table(routes) + ([f"- OpenGL: {without}", ""] if without else [])
    sizes = inference.SIZES[:1] if asked.quick else inference.SIZES
    engines, absent = inference.rows(networks, rounds=min(5, asked.rounds), sizes=sizes)
    found["engines"], found["missing_engines"] = [asdict(row) for row in engines], absent
    lines += ["## Inference", "", ENGINES, "", *tables.engines_table(engines)]
    lines += [*(f"- {name}: {why}" for name, why in absent.items()), ""]
    models = [name for name in (DEFAULT, f"{DEFAULT}-int8", "paper") if name in networks]
    measured_lines = list(
        tqdm(
            growth.lines(models, rounds=min(5, asked.rounds), quick=asked.quick),
            disable=None, unit="line", desc="growth", file=sys.stderr,
        )
    )  # fmt: skip
    found["growth"] = [asdict(line) | {"exponent": line.exponent} for line in measured_lines]
    figures.growth(measured_lines, out / "growth.png", title=f"How time grows; {_machine(found)}")
    lines += ["## Growth", "", GROWTH, "", *tables.growth_table(measured_lines)]
    return lines


OWN = (
    "Cold: from the start of the process to its end, the imports and the reading of the network included. Peak: most "
    "resident memory of the whole process, the interpreter included. Lenslets, one view, one run each."
)
ENGINES = (
    "Float network in, float picture out, all cores, networks open; in brackets how many times faster than the paper's "
    "generator in torch (eager, as its authors would run it), or in onnxruntime where torch is absent. Differences are "
    "to the float network in onnxruntime: an int8 twin's are what int8 costs on this picture at its worst pixel."
)
GROWTH = (
    "Views are of scene:hamburger with one sample a pixel, threads those of one call. Exponents: the power law through "
    "the upper half of the counts, where start-up costs weigh least."
)


def _explained(asked: Asked, works: Sequence[Work]) -> str:
    truths = {
        "mesh": "the view of an array with half the pitch, each pixel the mean of 4x4 rays over its own cell",
        "light field": "the given views themselves, which were halved to make the input (`lenslet`: the mean of 2x2 "
        "pixels; `pinhole`: points, of views at half size)",
    }
    truth = "; ".join(words for kind, words in truths.items() if any(work.kind == kind for work in works))
    return (
        f"Milliseconds: medians of {asked.rounds} round(s) in which methods take turns in one warm process: decoding "
        "or rendering (`by`: what `auto` took), upscaling and PNG together; `upscale ms`: the network. x paper's: "
        "how many times faster the whole job is than with the paper's generator in float onnxruntime. Errors are on Y, "
        f"against {truth}: PSNR in dB, SSIM, and the mean length of the gradients' difference (all pixels / the worst "
        "1 %, levels a pixel), over five views. Arithmetic means over the inputs, of PSNR without what is exact; "
        "pareto.png has geometric means of times and root mean squares of errors."
    )


def _heading(found: Mapping[str, Any]) -> list[str]:
    versions = ", ".join(f"{name} {at or 'absent'}" for name, at in found["machine"]["versions"].items())
    return [f"Machine: {_machine(found)}, {found['machine']['system']}. {versions}.", ""]


def _machine(found: Mapping[str, Any]) -> str:
    return f"{found['machine']['processor']}, {found['machine']['cores']} cores"


def _frontiers(means: Sequence[Any]) -> dict[str, list[str]]:
    keys = sorted({(point.sampling, point.lenses) for point in means})
    return {
        f"{lenses} lenses, {sampling}": [
            point.method
            for point in figures.frontier([p for p in means if (p.sampling, p.lenses) == (sampling, lenses)])
        ]
        for sampling, lenses in keys
    }


def _frontier_lines(frontier: Mapping[str, Sequence[str]]) -> list[str]:
    """Which methods no other beats in both time and error, and whether the default is one of them."""
    return [
        f"- {where}: {', '.join(f'`{name}`' for name in names)}"
        + ("" if default_name() in names else f" (not the default, `{default_name()}`)")
        for where, names in frontier.items()
    ]


def _finite(value: Any) -> Any:
    """JSON has neither infinity nor NaN: they become words."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "inf" if value > 0 else "-inf" if value < 0 else "nan"
    return value
