"""How fast the default path is, against what it replaces and against what the processor can do at all.

    python -m ciir.benchmarks.speed [--rounds 5] [--mesh FILE] [--eia FILE] [--only view|array|jobs|int8|png|memory ...]

`view`: a view of 512x512 pixels to 1024x1024, the model that `auto` takes for single pictures against the paper's
generator in float, both by onnxruntime; pixels to pixels, and the network alone. The view is noise, so that nothing can
be skipped. The processor's peak is the quickest product of two matrices of 1024x1024 by onnxruntime on all cores, float
and int8 (MatMul, MatMulInteger), in the same rounds; a network's share of it is by its card's multiply-adds. Both
are of the quickest quarter of the rounds.

`array`: a mesh to a whole upscaled elemental image array, 50x50 lenses of 15x15 pixels to 100x100 of 15x15: all 225
views, each doubled, interleaved again. Against the field's usual way: a perspective render for each lens, its pixels
mapped into views, the paper's generator in float on each. From bytes in memory to the array in memory.

`jobs`: whole jobs of 50x50 lenses from a mesh's bytes to encoded PNG, with sessions and the rendering context open, and
`ciir models` as a process from its start.

`int8`: each int8 network of single pictures against its float twin.

`png`: PNG coding as it is against libpng's at level 1 with the Paeth filter, of upscaled views and of an elemental
image array: time and size.

`memory`: most resident memory of a process that upscales all 225 views of 200x200 lenses into a zip.

Jobs take turns in one process, so that what slows the machine slows all; ratios are medians over rounds. Exit status 1
where a bound does not hold.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imagecodecs
import numpy as np

from ciir.benchmarks.bench.timing import alone, in_turns, timed
from ciir.benchmarks.bench.work import views, views_and_report
from ciir.models import catalogue
from ciir.models.sessions import count_available_cores, open_session
from ciir.models.single.network import SingleImageNetwork
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scenes import SCENES
from ciir.renderer.writers.formats import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct, render_eia
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from ciir.models.cards import Card
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

    Job = Callable[[], dict[str, float]]
    Checked = tuple[str, bool]
    """A line of the table that states a bound, and whether it holds."""

PAPER = "paper"
SIDE = 512
GEMM = 1024
"""Rows and columns of the matrices that show the peak: 1.1 G multiply-adds, in and out of the cache as layers are."""
LENSES, PIXELS = (50, 50), (15, 15)
MOST_SECONDS, VIEW_RATIO, ARRAY_RATIO, MOST_MIB = 3.0, 10.0, 6.0, 1.2e9 / 2**20
"""The bounds: of the whole array, of a view and the array against the usual way, and of memory."""
SIZES = ((200, 200), (360, 640))
"""Of the views that int8 networks are timed on, (rows, columns)."""
MESH, EIA = Path("../shared/data/meshes/duck.glb"), Path("../shared/data/lightfields/eia-200x200x15.jpg")


def quickest(work: Callable[[], object], times: int = 10) -> Job:
    """The quickest of some runs of `work` as a job: what nothing else on the machine held up."""
    return lambda: min((timed(work) for _ in range(times)), key=lambda run: run["total"])


def multiply_adds(card: Card, height: int, width: int) -> float:
    """Of a network for a picture of `height x width` input pixels."""
    return card.macs_per_output_pixel * height * width * card.scale**2


def product(*, int8: bool, side: int = GEMM) -> Callable[[], object]:
    """One product of two matrices of `side x side` by onnxruntime, the second a constant, as weights are."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    random = np.random.default_rng(0)
    kinds = (TensorProto.UINT8, TensorProto.INT32) if int8 else (TensorProto.FLOAT, TensorProto.FLOAT)
    left: NDArray[Any] = random.integers(0, 256, (side, side)).astype(np.uint8 if int8 else np.float32)
    right = random.integers(-127, 128, (side, side)).astype(np.int8 if int8 else np.float32)
    graph = helper.make_graph(
        [helper.make_node("MatMulInteger" if int8 else "MatMul", ["a", "b"], ["c"])],
        "product",
        [helper.make_tensor_value_info("a", kinds[0], [side, side])],
        [helper.make_tensor_value_info("c", kinds[1], [side, side])],
        [numpy_helper.from_array(right, "b")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    session = open_session(onnx.ModelProto.SerializeToString(model), count_available_cores())
    return lambda: session.run(["c"], {"a": left})


def network(name: str) -> SingleImageNetwork:
    """A shipped network of single pictures."""
    return SingleImageNetwork(catalogue.SHIPPED / f"{name}.json")


def view(rounds: int) -> Iterator[str | Checked]:
    """A view by the default and by the paper's generator, and the share of the peak that each reaches."""
    pixels = np.random.default_rng(0).integers(0, 256, (1, SIDE, SIDE, 3), np.uint8)
    planes = np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), np.float32) / np.float32(255)
    default = catalogue.default_name()
    networks = {name: network(name) for name in (PAPER, default)}
    jobs = {"float GEMM": quickest(product(int8=False)), "int8 GEMM": quickest(product(int8=True))}
    for name, model in networks.items():
        jobs[name] = partial(timed, partial(upscale_pixels, model, pixels))
        jobs[f"{name} alone"] = partial(timed, partial(model.run, {model.card.input.name: planes}))
    whole = in_turns(jobs, rounds, reference=PAPER)
    yield f"view {SIDE}x{SIDE} -> {2 * SIDE}x{2 * SIDE}, {rounds} rounds"
    peaks = {"float32": GEMM**3 / whole["float GEMM"].low, "int8": GEMM**3 / whole["int8 GEMM"].low}
    for precision, peak in peaks.items():
        yield f"  peak {precision}: {peak / 1e6:.0f} G multiply-adds a second"
    for name, model in networks.items():
        needed = multiply_adds(model.card, SIDE, SIDE)
        share = needed / whole[f"{name} alone"].low / peaks[model.card.precision]
        yield (
            f"  {name}: {whole[name].median:.0f} ms, alone {whole[f'{name} alone'].median:.0f} ms, "
            f"{needed / whole[f'{name} alone'].low / 1e6:.0f} G a second, {100 * share:.0f} % of the peak "
            f"of {model.card.precision}"
        )
    alone_ratio = whole[f"{PAPER} alone"].median / whole[f"{default} alone"].median
    yield f"  {default} alone: {alone_ratio:.1f} times faster than {PAPER} alone"
    ratio = whole[default].ratio or 0.0
    yield (
        f"  {default}: {ratio:.1f} times faster than {PAPER}, at least {VIEW_RATIO:.0f} asked for",
        ratio >= VIEW_RATIO,
    )


def upscaled(source: Source, options: Options) -> tuple[NDArray[np.uint8], Report]:
    """The elemental image array of all views of a mesh by the pipeline, and its report."""
    made, report = views_and_report(source, options)
    return LightField(made.reshape(*PIXELS, *made.shape[1:])).eia().astype(np.uint8), report


def usual(source: Source, options: Options) -> NDArray[np.uint8]:
    """The same array by a perspective render for each lens and `PAPER` on each view, nothing skipped."""
    array = resolve_array(options)
    scene = Input(source).read_mesh(options)
    raster = open_backend("raster")[0]
    placed = scene.transform(frame_scene(scene, array))
    eia = raster.render_by_lens(placed, array)[..., :3]  # type: ignore[attr-defined]  # the raster's own
    mapped = LightField.from_eia(eia, rows=array.rows, cols=array.cols).views
    v, u, rows, cols, channels = mapped.shape
    small = np.ascontiguousarray(mapped, np.uint8).reshape(v * u, rows, cols, channels)
    large: NDArray[np.uint8] = upscale_pixels(catalogue.load_upscaler(PAPER), small, skip=False)
    return LightField(large.reshape(v, u, *large.shape[1:])).eia().astype(np.uint8)


def whole_array(source: Source, rounds: int) -> Iterator[str | Checked]:
    """The upscaled elemental image array by each way."""
    options = Options(lenses=LENSES, pixels=PIXELS, views="all")
    single = Options(lenses=LENSES, pixels=PIXELS, views="all", model=catalogue.default_name())
    auto = f"auto ({upscaled(source, options)[1]['plan']['model']})"
    jobs = {
        "usual": partial(timed, lambda: usual(source, options)),
        auto: partial(timed, lambda: upscaled(source, options)),
        catalogue.default_name(): partial(timed, lambda: upscaled(source, single)),
    }
    times = in_turns(jobs, rounds, reference="usual")
    yield "mesh to an upscaled elemental image array, 50x50 -> 100x100 lenses of 15x15 pixels, seconds"
    yield f"  a render for each lens, then {PAPER}: {times['usual'].median / 1e3:.2f}"
    for name in (auto, catalogue.default_name()):
        yield f"  {name}: {times[name].median / 1e3:.2f}, {times[name].ratio:.1f} times faster"
    seconds, ratio = times[auto].median / 1e3, times[auto].ratio or 0.0
    yield f"  {auto}: {seconds:.2f} s, at most {MOST_SECONDS:.0f} asked for", seconds <= MOST_SECONDS
    yield f"  {auto}: {ratio:.1f} times faster, at least {ARRAY_RATIO:.0f} asked for", ratio >= ARRAY_RATIO


def jobs(mesh: Path, rounds: int) -> Iterator[str]:
    """Whole jobs, warm, with their stages, and the start of a process."""
    source, default = Bundle.from_path(mesh), catalogue.default_name()

    def one_view(**options: Any) -> dict[str, float]:
        asked = Options(lenses=LENSES, pixels=PIXELS, **options)
        return dict(reconstruct(source, asked, FileWriter(io.BytesIO(), None))["timings_ms"])

    def array(backend: Any) -> dict[str, float]:
        asked = Options(lenses=LENSES, pixels=PIXELS, backend=backend)
        return dict(render_eia(source, asked, encode_png)["timings_ms"])

    rows: dict[str, Job] = {}
    for backend in ("raster", "raytrace"):
        for model in (default, "bicubic"):
            rows[f"{backend}: view 50x50 -> 100x100, {model}"] = partial(one_view, backend=backend, model=model)
        rows[f"{backend}: view 100x100 directly"] = partial(one_view, backend=backend, strategy="direct")
        rows[f"{backend}: EIA 50x50 lenses of 15x15"] = partial(array, backend)
    command = [sys.executable, "-m", "ciir", "models"]
    rows["ciir models, cold start"] = partial(
        timed, partial(subprocess.run, command, check=True, stdout=subprocess.DEVNULL)
    )
    yield f"{source.name}, whole jobs from bytes to encoded PNG, milliseconds"
    for name, times in in_turns(rows, rounds).items():
        stages = "  ".join(f"{stage} {value:.1f}" for stage, value in times.stages.items())
        yield f"  {name:42s} {times.median:8.1f}  (quartiles {times.low:.1f}, {times.high:.1f})  {stages}"


def int8(rounds: int) -> Iterator[str]:
    """Each int8 network of single pictures against its float twin, on one core and on all."""
    yield "float networks against their int8 twins, milliseconds"
    cards = [entry.card for entry in catalogue.list_entries() if entry.card and not entry.is_light_field]
    for card in (card for card in cards if card.float_twin):
        for threads in sorted({1, count_available_cores()}):
            pair = [catalogue.load_upscaler(name, threads=threads) for name in (card.float_twin, card.name)]
            for height, width in SIZES:
                image = np.random.default_rng(0).random((1, 3, height, width), dtype=np.float32)
                times = in_turns(
                    {each.name: partial(timed, partial(each, image)) for each in pair},
                    rounds,
                    reference=card.float_twin,
                )
                plain, quick = (times[each.name] for each in pair)
                yield (
                    f"  {card.name:14s} {width}x{height}, {threads} core(s): float {plain.median:.1f}, "
                    f"int8 {quick.median:.1f}, {quick.ratio:.2f} times faster"
                )


def png(eia: Path, rounds: int) -> Iterator[str]:
    """Our PNG coding against libpng's at level 1 with the Paeth filter on all rows."""
    array: NDArray[Any] = pictures.decode(eia.read_bytes(), name=eia.name)[:1000, :1000, :3]
    shown = {scene: views(scene, Options(lenses=(200, 200)))[0] for scene in SCENES}
    yield "PNG of 8 bits, milliseconds and kB: libpng, ours"
    for name, picture in (shown | {eia.name: np.ascontiguousarray(array)}).items():
        both: dict[str, Callable[[], bytes | bytearray]] = {
            "libpng": partial(imagecodecs.png_encode, picture, level=1, filter=imagecodecs.PNG.FILTER.PAETH),
            "ours": partial(encode_png, picture),
        }
        times = in_turns({way: partial(timed, code) for way, code in both.items()}, 10 * rounds, reference="libpng")
        both_ways = ", ".join(f"{times[way].median:.2f} ms {len(code()) / 1e3:.0f} kB" for way, code in both.items())
        yield f"  {name} {picture.shape[1]}x{picture.shape[0]}: {both_ways}; {times['ours'].ratio:.1f} times faster"


def memory(eia: Path) -> Iterator[str | Checked]:
    """Peak memory of all views of 200x200 lenses of 15x15 pixels."""
    yield "all 225 views of 200x200 lenses, a process of its own"
    given = {"lenses": (200, 200), "pixels": PIXELS, "views": "all"}
    for source in ("scene:vase", str(eia)):
        peak = alone(source, given).peak_mib
        shown = "unknown on this system" if peak is None else f"{peak:.0f} MiB"
        yield f"  {Path(source).name}: {shown}, at most {MOST_MIB:.0f} asked for", peak is not None and peak <= MOST_MIB


def main(argv: list[str] | None = None) -> int:
    """Prints the parts that are asked for, all of them by default."""
    parser = argparse.ArgumentParser(prog="benchmarks.speed", description=main.__doc__)
    parts = ("view", "array", "jobs", "int8", "png", "memory")
    parser.add_argument("--rounds", type=int, default=5, help="times that each job runs (default 5)")
    parser.add_argument("--mesh", type=Path, default=MESH, help=f"mesh of the array and the jobs (default {MESH})")
    parser.add_argument("--eia", type=Path, default=EIA, help=f"elemental image array (default {EIA})")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts, help="parts to run (default: all)")
    given = parser.parse_args(argv)
    made: dict[str, Callable[[], Iterator[str | Checked]]] = {
        "view": lambda: view(given.rounds),
        "array": lambda: whole_array(Bundle.from_path(given.mesh), given.rounds),
        "jobs": lambda: jobs(given.mesh, given.rounds),
        "int8": lambda: int8(given.rounds),
        "png": lambda: png(given.eia, given.rounds),
        "memory": lambda: memory(given.eia),
    }
    holds = True
    for part in given.only:
        for row in made[part]():
            line, is_kept = (row, None) if isinstance(row, str) else row
            verdict = {None: "", True: ": holds", False: ": DOES NOT HOLD"}[is_kept]
            sys.stdout.write(f"{line}{verdict}\n")
            sys.stdout.flush()
            holds = holds and is_kept is not False
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
