"""Measures how fast the default is, compares it with its targets, and prints one table.

    python -m ciir.benchmarks.speed [--rounds 5] [--mesh FILE] [--peers NETWORK.onnx ...] [--only ROW ...]

Each job of a row runs once a round in one process. Times are medians over rounds, and ratios are medians within rounds.
On a machine that does other work too, processor time says more than wall-clock time. `int8` is not a row of the table:
it compares each int8 single-picture network with its float twin. The exit status is 1 if a target isn't reached.
"""

from __future__ import annotations

import argparse
import io
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import ciir
from ciir.benchmarks.bench.tables import format_table
from ciir.benchmarks.bench.timing import time_call, time_in_rounds
from ciir.benchmarks.bench.work import reconstruct_views
from ciir.benchmarks.machine import describe
from ciir.cores import count_available_cores
from ciir.models import catalogue
from ciir.models.light_field.strides import choose_stride, list_spaced_views, upscale_spaced_views
from ciir.models.light_field.views import upscale_views
from ciir.models.sessions import open_session
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.view_order.motion import measure_motion
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.elemental import render_eia
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.views import View

    Work = Callable[[], object]

PAPER = "paper"
QUICK = "fast"
"""The quickest network, as float."""
LENSES, PIXELS = (50, 50), (15, 15)
SIZES = ((200, 200), (360, 640))
"""Sizes of the views that int8 networks are timed on, (rows, columns)."""
SHARED = Path("../shared/data")


@dataclass(frozen=True)
class Given:
    """The inputs that the rows are measured on."""

    mesh: Bundle
    fine_mesh: Path
    light_field: Path
    peers: tuple[Path, ...]


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    what: str
    work: Work
    wanted: float | None = None
    """The target in milliseconds."""
    others: Mapping[str, tuple[Work, float | None]] = field(default_factory=dict)
    """Other ways to the same result, and how many times faster than them ours should be."""
    factor: int = 1
    """How many times the measured work the row stands for."""


def measure_view(given: Given) -> Row:
    """Measures a view of noise, of which nothing is skipped, with the quickest network."""
    pixels = np.random.default_rng(0).integers(0, 256, (1, 512, 512, 3), np.uint8)
    planes = np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), np.float32) / np.float32(255)
    quick = catalogue.prefer_int8(QUICK)
    ours, paper = (partial(upscale_pixels, catalogue.load_upscaler(name), pixels) for name in (quick, PAPER))
    others: dict[str, tuple[Work, float | None]] = {PAPER: (paper, 22.0)}
    for path in given.peers:
        session = open_session(path.read_bytes(), count_available_cores())
        others[path.stem] = partial(session.run, None, {session.get_inputs()[0].name: planes}), None
    return Row(f"one view of 512x512 by `{quick}`", ours, others=others)


def measure_cold(given: Given) -> Row:  # noqa: ARG001 - all rows have one signature
    """Measures a command for one view of a small scene, from the start of its process."""
    return Row("`ciir reconstruct scene:vase`", partial(run_command, "scene:vase"), 400)


def measure_fine(given: Given) -> Row:
    """Measures a command for one view of a fine mesh."""
    run = partial(run_command, given.fine_mesh, "--lenses", "200x200", "--sampling", "lenslet", "--neighbour-time", "0")
    others = {f"`--backend {name}`": (partial(run, "--backend", name), 1.0) for name in ("raster", "raytrace")}
    return Row(f"`ciir reconstruct {given.fine_mesh.name}`, 200x200 lenslets, `--neighbour-time 0`", run, others=others)


def measure_eia(given: Given) -> Row:
    """Measures an elemental image array by rays, the whole job from bytes to PNG."""
    options = Options(lenses=LENSES, pixels=PIXELS, backend="raytrace")
    return Row("EIA 50x50 of 15x15 by rays", partial(render_eia, given.mesh, options, encode_png), 90)


def measure_rays(given: Given) -> Row:
    """Measures one view by 16 rays for each pixel, from a scene that has been read."""
    scene = Input(given.mesh).read_mesh(Options())
    array = resolve_array(Options(lenses=(100, 100), pixels=PIXELS))
    placed, rays = scene.transform(frame_scene(scene, array)), open_backend("raytrace")[0]
    return Row(
        "one view 100x100, 16 samples, by rays", lambda: list(rays.render_views(placed, array, [(7, 7)], samples=4)), 20
    )


def measure_array(given: Given) -> Row:
    """Measures a mesh to a whole upscaled elemental image array, from bytes in memory to the array in memory."""
    options = Options(lenses=LENSES, pixels=PIXELS, views="all")
    single = Options(lenses=LENSES, pixels=PIXELS, views="all", model=catalogue.prefer_int8(QUICK))
    others: dict[str, tuple[Work, float | None]] = {
        f"a render for each lens, then {PAPER}": (partial(upscale_array_usually, given.mesh, options), 6.0),
        single.model: (partial(upscale_array, given.mesh, single), None),
    }
    return Row(
        "mesh to an array of 100x100 of 15x15, default", partial(upscale_array, given.mesh, options), 450, others
    )


def measure_small_views(given: Given) -> Row:
    """Measures 5 times 3 views of an elemental image array, the batch of the pipeline, from its upper left to its lower
    right corner.

    They stand for all 225, because views at the border need the fallback more than those in the middle.
    """
    views = ciir.open(given.light_field, lenses=(200, 200)).views
    works = [make_work(views, 3, at) for at in ((1, 0), (4, 3), (7, 6), (10, 9), (13, 12))]
    name = "225 views of 200x200 of an EIA, default (15 views, times 15)"
    return Row(name, lambda: [work() for work in works], 8000, factor=15)


def measure_large_views(given: Given) -> Row:
    """Measures a view of 512x512 with its window, which stands for 81 of them. The views are those of 200x200,
    mirrored.
    """
    views = ciir.open(given.light_field, lenses=(200, 200)).views[5:10, 5:10]
    margin = (0, 0), (0, 0), (0, 312), (0, 312), (0, 0)
    work = make_work(np.pad(views, margin, mode="symmetric"), 1)
    return Row("81 views of 512x512, default (1 view, times 81)", work, 22000, factor=81)


def measure_job(given: Given) -> Row:
    """Measures a whole job from bytes to PNG, with sessions and the rendering context open."""
    options = Options(lenses=LENSES, pixels=PIXELS, neighbour_time=0.0)
    run = partial(reconstruct, given.mesh, options)
    return Row("one view 50x50, warm, whole job", lambda: run(FileWriter(io.BytesIO(), None)), 6)


ROWS = {
    "view": measure_view,
    "fine": measure_fine,
    "eia": measure_eia,
    "rays": measure_rays,
    "array": measure_array,
    "views-200": measure_small_views,
    "views-512": measure_large_views,
    "job": measure_job,
    "cold": measure_cold,
}
"""The rows, in the order of the table."""


def run_command(*arguments: object) -> None:
    """Runs `ciir reconstruct`. Python keeps its compiled files, as by default."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "ciir", "reconstruct", *map(str, arguments), "-o", f"{folder}/view.png"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)


def make_work(views: NDArray[Any], count: int, at: View | None = None) -> Work:
    """Returns a function that upscales `count` views from `at` on, by default the middle one, with the default of light
    fields.
    """
    grid = views.shape[0], views.shape[1]
    row, col = at or (grid[0] // 2, grid[1] // 2)
    network = catalogue.load_light_field_network(catalogue.light_field_default_name())
    fallback = catalogue.load_upscaler(catalogue.picture_default_name())
    wanted = [(row, col + number) for number in range(count)]
    stride = choose_stride(measure_motion(views), grid)
    pictures = {view: np.ascontiguousarray(views[view]) for view in list_spaced_views(wanted, grid, stride)}
    upscale = partial(upscale_views, network, fallback, finds_sampling=True)
    return partial(upscale_spaced_views, upscale, pictures, wanted, grid, stride)


def upscale_array(source: Bundle, options: Options) -> NDArray[np.uint8]:
    """Computes the elemental image array of all views of a mesh with the pipeline."""
    views, _ = reconstruct_views(source, options)
    return LightField(views.reshape(*PIXELS, *views.shape[1:])).eia().astype(np.uint8)


def upscale_array_usually(source: Bundle, options: Options) -> NDArray[np.uint8]:
    """Computes the same array with a perspective render for each lens and `PAPER` on each view, nothing skipped."""
    array = resolve_array(options)
    scene = Input(source).read_mesh(options)
    raster = open_backend("raster")[0]
    placed = scene.transform(frame_scene(scene, array))
    eia = raster.render_by_lens(placed, array)[..., :3]  # type: ignore[attr-defined]  # only the raster backend has it
    mapped = LightField.from_eia(eia, rows=array.rows, cols=array.cols).views
    v, u, rows, cols, channels = mapped.shape
    small = np.ascontiguousarray(mapped, np.uint8).reshape(v * u, rows, cols, channels)
    large: NDArray[np.uint8] = upscale_pixels(catalogue.load_upscaler(PAPER), small, skip=False)
    return LightField(large.reshape(v, u, *large.shape[1:])).eia().astype(np.uint8)


def measure_row(row: Row, rounds: int) -> tuple[list[list[str]], bool]:
    """Returns the lines of the table for a row, and whether all its targets are reached."""
    works = {row.what: row.work} | {name: work for name, (work, _) in row.others.items()}
    times = time_in_rounds({name: partial(time_call, work) for name, work in works.items()}, rounds, reference=row.what)
    ours = times[row.what]
    now = row.factor * ours.median
    holds = row.wanted is None or now <= row.wanted
    lines = [[row.what, f"{now:.0f}", f"{row.factor * ours.stages['cpu']:.0f}", f"{row.wanted or '-'}", "-", "-"]]
    for name, (_, least) in row.others.items():
        ratio = 1 / (times[name].ratio or 1.0)
        holds = holds and (least is None or ratio >= least)
        cpu = times[name].stages["cpu"]
        lines.append([f"- {name}", f"{times[name].median:.0f}", f"{cpu:.0f}", "-", f"{ratio:.2f}", f"{least or '-'}"])
    return lines, holds


def compare_int8(rounds: int) -> Iterator[str]:
    """Compares each int8 single-picture network with its float twin, on one core and on all."""
    yield "float networks against their int8 twins, milliseconds"
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
                yield f"  {card.name:14s} {width}x{height}, {threads} core(s): {text}"


def main(argv: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="benchmarks.speed", description=str(__doc__).splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="times that each job runs (default 5)")
    parser.add_argument("--mesh", type=Path, default=SHARED / "meshes/duck.glb")
    parser.add_argument("--fine-mesh", type=Path, default=SHARED / "meshes/boot.obj")
    parser.add_argument("--light-field", type=Path, default=SHARED / "lightfields/eia-200x200x15.jpg")
    parser.add_argument("--peers", type=Path, nargs="*", default=[], help="ONNX networks of others, for `view`")
    parser.add_argument("--only", nargs="+", choices=[*ROWS, "int8"], default=list(ROWS), help="rows (default: all)")
    args = parser.parse_args(argv)
    machine: dict[str, Any] = describe()
    print(f"{machine['processor']}, {machine['cores']} cores, {'int8' if machine['int8'] else 'float'} networks")
    given = Given(Bundle.from_path(args.mesh), args.fine_mesh, args.light_field, tuple(args.peers))
    rows, reached = [], True
    for name in args.only:
        if name == "int8":
            print("\n".join(compare_int8(args.rounds)))
            continue
        lines, holds = measure_row(ROWS[name](given), args.rounds)
        rows += lines
        reached = reached and holds
    if rows:
        head = ["what", "ms", "processor ms", "wanted ms", "times faster", "wanted"]
        print("\n".join(format_table(head, rows)))
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
