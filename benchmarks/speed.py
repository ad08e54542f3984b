"""Measures how fast the default path is, against the paper's network and the usual way to a whole array.

    python -m ciir.benchmarks.speed [--rounds 5] [--mesh FILE] [--only view|array|jobs|int8 ...]

`view`: a view of 512x512 pixels to 1024x1024 by the default network for single pictures and by the paper's generator,
both in onnxruntime. The view is noise, so that nothing can be skipped.

`array`: a mesh to a whole upscaled elemental image array, 50x50 lenses of 15x15 pixels to 100x100 of 15x15: all 225
views, each doubled, interleaved again. Against the field's usual way: a perspective render for each lens, its pixels
mapped into views, the paper's generator on each. From bytes in memory to the array in memory.

`jobs`: whole jobs of 50x50 lenses from a mesh's bytes to encoded PNG, with sessions and the rendering context open, and
`ciir models` as a process from its start.

`int8`: each int8 network of single pictures against its float twin.

Every job runs once a round in one process; ratios are medians over rounds. Exit status 1 where a bound does not hold.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.benchmarks.bench.timing import time_call, time_in_rounds
from ciir.benchmarks.bench.work import reconstruct_views
from ciir.models import catalogue
from ciir.models.sessions import count_available_cores
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.formats import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct, render_eia
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from ciir.service.pipeline.report import Report

    Line = tuple[str, bool | None]
    """A line of output, and whether the bound that it states holds; None where it states none."""

PAPER = "paper"
SIDE = 512
LENSES, PIXELS = (50, 50), (15, 15)
MOST_SECONDS, VIEW_RATIO, ARRAY_RATIO = 3.0, 10.0, 6.0
"""The bounds: on the whole array, and on a view and the array against the usual way."""
SIZES = ((200, 200), (360, 640))
"""Of the views that int8 networks are timed on, (rows, columns)."""
MESH = Path("../shared/data/meshes/duck.glb")


def measure_view(mesh: Path, rounds: int) -> Iterator[Line]:  # noqa: ARG001 - all parts have one signature
    """One view by the default network and by the paper's."""
    pixels = np.random.default_rng(0).integers(0, 256, (1, SIDE, SIDE, 3), np.uint8)
    names = (PAPER, catalogue.default_name())
    jobs = {name: partial(time_call, partial(upscale_pixels, catalogue.load_upscaler(name), pixels)) for name in names}
    times = time_in_rounds(jobs, rounds, reference=PAPER)
    for name in names:
        yield f"view {SIDE}x{SIDE} -> {2 * SIDE}x{2 * SIDE}, {name}: {times[name].median:.0f} ms", None
    ratio = times[names[1]].ratio or 0.0
    yield f"  {names[1]}: {ratio:.1f} times faster than {PAPER}, at least {VIEW_RATIO:.0f}", ratio >= VIEW_RATIO


def upscale_array(source: Bundle, options: Options) -> tuple[NDArray[np.uint8], Report]:
    """The elemental image array of all views of a mesh by the pipeline, and its report."""
    views, report = reconstruct_views(source, options)
    return LightField(views.reshape(*PIXELS, *views.shape[1:])).eia().astype(np.uint8), report


def upscale_array_usually(source: Bundle, options: Options) -> NDArray[np.uint8]:
    """The same array by a perspective render for each lens and `PAPER` on each view, nothing skipped."""
    array = resolve_array(options)
    scene = Input(source).read_mesh(options)
    raster = open_backend("raster")[0]
    placed = scene.transform(frame_scene(scene, array))
    eia = raster.render_by_lens(placed, array)[..., :3]  # type: ignore[attr-defined]  # of the raster backend alone
    mapped = LightField.from_eia(eia, rows=array.rows, cols=array.cols).views
    v, u, rows, cols, channels = mapped.shape
    small = np.ascontiguousarray(mapped, np.uint8).reshape(v * u, rows, cols, channels)
    large: NDArray[np.uint8] = upscale_pixels(catalogue.load_upscaler(PAPER), small, skip=False)
    return LightField(large.reshape(v, u, *large.shape[1:])).eia().astype(np.uint8)


def measure_array(mesh: Path, rounds: int) -> Iterator[Line]:
    """The upscaled elemental image array by each way."""
    source = Bundle.from_path(mesh)
    options = Options(lenses=LENSES, pixels=PIXELS, views="all")
    single = Options(lenses=LENSES, pixels=PIXELS, views="all", model=catalogue.default_name())
    auto = f"auto ({upscale_array(source, options)[1]['plan']['model']})"
    jobs = {
        "usual": partial(time_call, lambda: upscale_array_usually(source, options)),
        auto: partial(time_call, lambda: upscale_array(source, options)),
        catalogue.default_name(): partial(time_call, lambda: upscale_array(source, single)),
    }
    times = time_in_rounds(jobs, rounds, reference="usual")
    yield "mesh to an upscaled elemental image array, 50x50 -> 100x100 lenses of 15x15 pixels, seconds", None
    yield f"  a render for each lens, then {PAPER}: {times['usual'].median / 1e3:.2f}", None
    for name in (auto, catalogue.default_name()):
        yield f"  {name}: {times[name].median / 1e3:.2f}, {times[name].ratio:.1f} times faster", None
    seconds, ratio = times[auto].median / 1e3, times[auto].ratio or 0.0
    yield f"  {auto}: {seconds:.2f} s, at most {MOST_SECONDS:.0f}", seconds <= MOST_SECONDS
    yield f"  {auto}: {ratio:.1f} times faster, at least {ARRAY_RATIO:.0f}", ratio >= ARRAY_RATIO


def measure_jobs(mesh: Path, rounds: int) -> Iterator[Line]:
    """Whole jobs, warm, with their stages, and the start of a process."""
    source, default = Bundle.from_path(mesh), catalogue.default_name()

    def reconstruct_view(**options: Any) -> dict[str, float]:
        job = Options(lenses=LENSES, pixels=PIXELS, **options)
        return dict(reconstruct(source, job, FileWriter(io.BytesIO(), None))["timings_ms"])

    def render_array(backend: Any) -> dict[str, float]:
        job = Options(lenses=LENSES, pixels=PIXELS, backend=backend)
        return dict(render_eia(source, job, encode_png)["timings_ms"])

    rows: dict[str, Callable[[], dict[str, float]]] = {}
    for backend in ("raster", "raytrace"):
        for model in (default, "bicubic"):
            rows[f"{backend}: view 50x50 -> 100x100, {model}"] = partial(reconstruct_view, backend=backend, model=model)
        rows[f"{backend}: view 100x100 directly"] = partial(reconstruct_view, backend=backend, strategy="direct")
        rows[f"{backend}: EIA 50x50 lenses of 15x15"] = partial(render_array, backend)
    command = partial(subprocess.run, [sys.executable, "-m", "ciir", "models"], check=True, stdout=subprocess.DEVNULL)
    rows["ciir models, cold start"] = partial(time_call, command)
    yield f"{source.name}, whole jobs from bytes to encoded PNG, milliseconds", None
    for name, times in time_in_rounds(rows, rounds).items():
        stages = "  ".join(f"{stage} {value:.1f}" for stage, value in times.stages.items())
        yield f"  {name:42s} {times.median:8.1f}  (quartiles {times.low:.1f}, {times.high:.1f})  {stages}", None


def measure_int8(mesh: Path, rounds: int) -> Iterator[Line]:  # noqa: ARG001 - all parts have one signature
    """Each int8 network of single pictures against its float twin, on one core and on all."""
    yield "float networks against their int8 twins, milliseconds", None
    cards = [entry.card for entry in catalogue.list_entries() if entry.card and not entry.is_light_field]
    for card in (card for card in cards if card.float_twin):
        for threads in sorted({1, count_available_cores()}):
            pair = [catalogue.load_upscaler(name, threads=threads) for name in (card.float_twin, card.name)]
            for height, width in SIZES:
                image = np.random.default_rng(0).random((1, 3, height, width), dtype=np.float32)
                jobs = {network.name: partial(time_call, partial(network, image)) for network in pair}
                times = time_in_rounds(jobs, rounds, reference=card.float_twin)
                plain, quick = (times[network.name] for network in pair)
                text = f"float {plain.median:.1f}, int8 {quick.median:.1f}, {quick.ratio:.2f} times faster"
                yield f"  {card.name:14s} {width}x{height}, {threads} core(s): {text}", None


PARTS = {"view": measure_view, "array": measure_array, "jobs": measure_jobs, "int8": measure_int8}


def main(argv: list[str] | None = None) -> int:
    """Prints the selected parts, all of them by default."""
    parser = argparse.ArgumentParser(prog="benchmarks.speed", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="times that each job runs (default 5)")
    parser.add_argument("--mesh", type=Path, default=MESH, help=f"mesh of the array and the jobs (default {MESH})")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="parts to run (default: all)")
    args = parser.parse_args(argv)
    all_hold = True
    for part in args.only:
        for line, holds in PARTS[part](args.mesh, args.rounds):
            verdict = {None: "", True: ": holds", False: ": DOES NOT HOLD"}[holds]
            print(f"{line}{verdict}", flush=True)
            all_hold = all_hold and holds is not False
    return 0 if all_hold else 1


if __name__ == "__main__":
    sys.exit(main())
