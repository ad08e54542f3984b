"""What a light-field network gains over single pictures, what it costs, and whether it does harm or bends the parallax.

    python -m ciir.benchmarks.light_fields ../shared/data/lightfields/knights --mesh ../shared/data/meshes/duck.glb

Accuracy: Y-PSNR in dB over the inner views of the middle 5x5 and 9x9 of a folder of views, made small in three ways,
and over the centre view of meshes seen by pinholes. Time: one view, models in turn. Harm: windows of another scene,
views moved by more than the network was taught, noise. Parallax: disparity between upscaled
neighbours against the truth's.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.timing import in_turns, timed
from ciir.benchmarks.bench.work import views as rendered
from ciir.benchmarks.parallax import disparities
from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.readers.bundle import Bundle
from ciir.service.pipeline.options import Options
from ciir.training.data import downscale, light_fields
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from ciir.training.data.light_fields import Pair

    Views = NDArray[np.uint8]
    """`(V, U, H, W, 3)`."""

SINGLES = ("bicubic", "fast", "quality")
GRIDS = (5, 9)
LENSES = (50, 100)
SHIFTS = (1, 3, 8)
"""Whole LR pixels by which each view is moved on the one before: the network looks for 2 at most."""
SIGMAS = (10, 40)
"""Standard deviations of noise, 8-bit levels."""
SIZES = (50, 100, 200)
ROUNDS = 9


def upscaled(model: str, low: Views, at: tuple[int, int]) -> NDArray[np.uint8]:
    """View `at` of a small light field by `model`, which sees the others too where it can."""
    if model in catalogue.list_single_image_names():
        single: NDArray[np.uint8] = upscale_pixels(catalogue.load_upscaler(model), low[at][np.newaxis])[0]
        return single
    grid = (low.shape[0], low.shape[1])
    every = {(v, u): low[v, u] for v in range(grid[0]) for u in range(grid[1])}
    network, alone = catalogue.load_light_field_network(model), catalogue.load_upscaler(catalogue.DEFAULT)
    made, _ = upscale_views(network, alone, every, [at], grid)
    picture: NDArray[np.uint8] = made[0].astype(np.uint8)
    return picture


def score(model: str, low: Views, truths: dict[tuple[int, int], NDArray[np.uint8]]) -> float:
    """Mean Y-PSNR in dB of the views that there is a truth of; a border of 2 is cut."""
    return float(
        np.mean(
            [
                compute_psnr(rgb_to_luma(upscaled(model, low, at)), rgb_to_luma(truth), border=2)
                for at, truth in truths.items()
            ]
        )
    )


def of(pair: Pair, at: Sequence[tuple[int, int]]) -> dict[tuple[int, int], NDArray[np.uint8]]:
    """The truths of some views."""
    return {(v, u): pair.high[v, u] for v, u in at}


def captured(folder: Path, row: Row) -> None:
    """A light field made small: the middle of the grid, and its corners."""
    for count in GRIDS:
        views = light_fields.read_views(folder, grid=(count, count))
        middle, last = count // 2, count - 1
        for kind in downscale.KINDS:
            pair = light_fields.degrade_views(views, kind, 2)
            row(f"{folder.name} {count}x{count} {kind}, inner", pair.low, of(pair, [(middle, middle)]))
            row(f"{folder.name} {count}x{count} {kind}, corners", pair.low, of(pair, [(0, 0), (0, last), (last, last)]))


def meshes(files: Sequence[Path], row: Row) -> None:
    """The centre view, by pinholes, framed as `ciir reconstruct` frames it."""
    for file in files:
        for lenses in LENSES:
            asked = Options(lenses=(lenses, lenses), pixels=(15, 15), model="none")
            spots = ";".join(f"{v},{u}" for v in range(5, 10) for u in range(5, 10))
            low = rendered(Bundle.from_path(file), Options(**{**asked.as_dict(), "views": spots}))
            direct = Options(**{**asked.as_dict(), "strategy": "direct", "model": "auto", "backend": "raytrace"})
            truth = rendered(Bundle.from_path(file), direct)[0]
            row(f"{file.stem} {lenses}x{lenses} lenses", low.reshape(5, 5, *low.shape[1:]), {(2, 2): truth})


def harm(folder: Path, row: Row) -> None:
    """What a network must not fall for."""
    views = light_fields.read_views(folder, grid=(5, 5))
    random = np.random.default_rng(0)
    for kind in ("bicubic", "point"):
        low, high = light_fields.degrade_views(views, kind, 2)
        truth = {(2, 2): high[2, 2]}
        strange = np.ascontiguousarray(low[:, :, ::-1, ::-1])
        mixed = strange.copy()
        mixed[2, 2] = low[2, 2]
        row(f"{kind}, around it another scene", mixed, truth)
        halves = low.copy()
        halves[:, 3:] = strange[:, 3:]
        row(f"{kind}, on the right another scene", halves, truth)
        for shift in SHIFTS:
            row(f"{kind}, each view moved by {shift}", moved(low, shift), truth)
        for sigma in SIGMAS:
            noisy = np.clip(low + random.normal(0, sigma, low.shape), 0, 255).round().astype(np.uint8)
            row(f"{kind}, noise of {sigma} levels", noisy, truth)
    white = light_fields.degrade_views(random.integers(0, 256, views.shape).astype(np.uint8), "bicubic", 2)
    row("nothing but noise", white.low, of(white, [(2, 2)]))


def moved(low: Views, shift: int) -> Views:
    """Each view rolled by `shift` pixels for each step from the middle."""
    result = low.copy()
    for v in range(low.shape[0]):
        for u in range(low.shape[1]):
            by = ((v - low.shape[0] // 2) * shift, (u - low.shape[1] // 2) * shift)
            result[v, u] = np.roll(low[v, u], by, (0, 1))
    return result


def parallax(folder: Path, models: Sequence[str], write: Callable[[str], object]) -> None:
    """Median and 90 % quantile of how far disparity is off, over textured patches, right and down of the middle."""
    views = light_fields.read_views(folder, grid=(7, 7))
    for kind in downscale.KINDS:
        low, high = light_fields.degrade_views(views, kind, 2)
        for model in models:
            far: list[NDArray[np.float64]] = []
            for axis, other in ((0, (4, 3)), (1, (3, 4))):
                here, there = (rgb_to_luma(upscaled(model, low, at)) for at in ((3, 3), other))
                true_here, true_there = (rgb_to_luma(high[at]) for at in ((3, 3), other))
                difference = disparities(here, there, axis) - disparities(true_here, true_there, axis)
                far.append(np.abs(difference).ravel())
            found = np.concatenate(far)
            found = found[np.isfinite(found)]
            middle, most = np.median(found), np.quantile(found, 0.9)
            words = f"median {middle:.3f}, 90 % {most:.3f}, of {len(found)} patches"
            write(f"{folder.name} {kind:8s} {model:12s} {words}\n")


def times(models: Sequence[str], folder: Path, write: Callable[[str], object]) -> None:
    """Milliseconds for the middle view of a light field from pixels to pixels, on one core and on all; in brackets over
    those of `quality`.
    """
    views = light_fields.read_views(folder, grid=(5, 5))
    for threads in (1, None):
        for size in SIZES:
            part = np.ascontiguousarray(views[:, :, :size, :size])
            jobs = {model: job(model, threads, part) for model in models}
            found = in_turns(jobs, ROUNDS, reference="quality")
            words = "  ".join(f"{m} {t.median:.1f} ms ({1 / (t.ratio or 1):.2f})" for m, t in found.items())
            write(f"{size}x{size}, {threads or 'all'} core(s): {words}\n")


def job(model: str, threads: int | None, low: Views) -> Callable[[], dict[str, float]]:
    """The middle one of 5x5 views."""
    if model in catalogue.list_single_image_names():
        single = catalogue.load_upscaler(model, threads=threads)
        return lambda: timed(lambda: upscale_pixels(single, low[2, 2][np.newaxis]))
    network = catalogue.load_light_field_network(model, threads=threads)
    alone = catalogue.load_upscaler(catalogue.DEFAULT, threads=threads)
    every = {(v, u): low[v, u] for v in range(5) for u in range(5)}
    return lambda: timed(lambda: upscale_views(network, alone, every, [(2, 2)], (5, 5)))


class Row:
    """Prints a line for each light field: every model's score, and the light-field network's less the others'."""

    def __init__(self, models: Sequence[str], write: Callable[[str], object]) -> None:
        self._models, self._write = models, write
        write(f"{'Y-PSNR':44s}" + "".join(f"{model:>11s}" for model in models) + f"{'- quality':>11s}{'- fast':>9s}\n")

    def __call__(self, name: str, low: Views, truths: dict[tuple[int, int], NDArray[np.uint8]]) -> None:
        """`truths`: (v, u) -> the view that ought to come out."""
        found = {model: score(model, low, truths) for model in self._models}
        first = found[self._models[0]]
        words = "".join(f"{found[model]:11.2f}" for model in self._models)
        self._write(f"{name:44s}{words}{first - found['quality']:+11.2f}{first - found['fast']:+9.2f}\n")


def main(argv: list[str] | None = None) -> int:
    """Prints all tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.light_fields", description=main.__doc__)
    parser.add_argument("folder", type=Path, help="views of a light field, 9x9 or more")
    parser.add_argument("--mesh", type=Path, nargs="*", default=[], help="mesh files")
    parser.add_argument("--model", nargs="+", default=["field"], help="light-field networks")
    parser.add_argument("--no-times", action="store_true", help="leave the times out")
    given = parser.parse_args(argv)

    def write(text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()

    row = Row((*given.model, *SINGLES), write)
    captured(given.folder, row)
    meshes(given.mesh, row)
    harm(given.folder, row)
    write("\nDisparity between upscaled neighbours against the truth's, pixels of the truth\n")
    parallax(given.folder, (*given.model, *SINGLES), write)
    if not given.no_times:
        write("\nOne view of 5x5, from pixels to pixels; in brackets: over quality's time\n")
        times(("quality", *given.model, "fast"), given.folder, write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
