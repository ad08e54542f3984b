"""Measures what exact skipping gains, for views and for the triangles of a mesh (culling).

    python -m ciir.benchmarks.skipping [--model NAME ...] [--lenses 100 200 512] [--mesh FILE ...] [--rounds 11]
        [--only views|full|culling ...]

`views`: middle views of the shipped scenes, through the upscale stage alone, with and without skipping; `faster` is the
median over rounds of the ratio of the two. `covered` is the share of the view that the object covers, and `seen` the
share that went through the network, including the halo. `differs`: the largest difference in levels of 255; 0 for int8
networks. `full`: views of noise, in which nothing can be skipped.

`culling`: one view and five (`cross`) of each mesh with both backends, with and without culling, whose own time counts.
`culled` is the share of triangles. If culling is not worthwhile (`renderer.backends.culling.is_worthwhile`), it is
forced, and the row says `not done`. `!` marks pixels that differ, and rows in which culling is done and takes over 3 %
longer.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.timing import time_call, time_in_rounds
from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.backends import culling, open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scenes import SCENES, load_scene
from ciir.renderer.views import parse_views
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.backends import Backend
    from ciir.renderer.scene import Scene

    Views = dict[tuple[int, int], NDArray[np.uint8]]
    Upscale = Callable[[bool, SkipStatistics], NDArray[np.uint8]]

MODELS = ("fast-int8", "field-int8")
SIDE = 5
"""Views along each side of the window around the middle one of 15x15. Light-field networks use all of them."""
SLOWER = 1.03
"""How many times as long rendering may take with culling."""


def load_upscale(name: str, views: Views) -> Upscale:
    """Returns a function that upscales the middle one of `SIDE` x `SIDE` views `(H, W, 3)` with the model `name`."""
    middle = (SIDE // 2, SIDE // 2)
    if name in catalogue.list_single_image_names():
        model, picture = catalogue.load_upscaler(name), np.ascontiguousarray(views[middle][np.newaxis])
        return lambda skip, statistics: upscale_pixels(model, picture, skip=skip, statistics=statistics)
    network = catalogue.load_light_field_network(name)
    fallback = catalogue.load_upscaler(catalogue.picture_default_name())
    grid = (SIDE, SIDE)
    return lambda skip, statistics: upscale_views(
        network, fallback, views, [middle], grid, skip=skip, statistics=statistics
    )[0].astype(np.uint8)


def measure_skipping(upscale: Upscale, rounds: int) -> list[str]:
    """Measures the share that went through the network, milliseconds with and without skipping, their ratio, and the
    difference.
    """
    statistics = SkipStatistics()
    difference = np.abs(upscale(True, statistics).astype(int) - upscale(False, SkipStatistics())).max()
    jobs = {
        name: partial(time_call, partial(upscale, name == "skipped", SkipStatistics())) for name in ("whole", "skipped")
    }
    times = time_in_rounds(jobs, rounds, reference="whole")
    seen = 1 - statistics.uniform / statistics.pixels
    medians = [f"{times[name].median:.2f}" for name in ("skipped", "whole")]
    return [f"{seen:.3f}", *medians, f"{times['skipped'].ratio:.2f}", str(difference)]


def render_window(mesh: Scene, lenses: int) -> Views:
    """Renders RGBA views of the window around the middle one, `(lenses, lenses, 4)`, numbered from 0."""
    array = LensArray(lenses, lenses, 15, 15)
    low = (15 - SIDE) // 2
    at = [(v, u) for v in range(low, low + SIDE) for u in range(low, low + SIDE)]
    placed = mesh.transform(frame_scene(mesh, array))
    views = open_backend("raytrace")[0].render_views(placed, array, at, samples=1)
    return {(v - low, u - low): view for (v, u), view in zip(at, views, strict=True)}


def measure_culling(
    placed: Scene, array: LensArray, views: Sequence[tuple[int, int]], backend: Backend, rounds: int
) -> tuple[float, float, float, int]:
    """Measures the share of culled triangles, milliseconds without and with culling, and the number of pixels that
    differ.

    The scene is new to the backend each time, as in a job.
    """

    def render(*, is_culling: bool) -> NDArray[np.uint8]:
        scene = replace(placed)
        scene = culling.cull_scene(scene, array, views) if is_culling else scene
        return np.stack(list(backend.render_views(scene, array, views)))

    share = 1 - culling.cull_scene(placed, array, views).triangles / placed.triangles
    differs = int((render(is_culling=False) != render(is_culling=True)).any(axis=-1).sum())
    jobs = {str(flag): partial(time_call, partial(render, is_culling=flag)) for flag in (False, True)}
    times = time_in_rounds(jobs, rounds)
    return share, times["False"].median, times["True"].median, differs


def print_views(models: Sequence[str], scenes: dict[str, Scene], lenses: Sequence[int], rounds: int) -> None:
    """Prints a row for each scene, size and model."""
    _print_row(("model", "scene", "lenses", "covered", "seen", "ms with", "without", "faster", "differs"))
    for name, mesh in scenes.items():
        for size in lenses:
            window = render_window(mesh, size)
            covered = (window[SIDE // 2, SIDE // 2][..., 3] > 0).mean()
            views = {at: np.ascontiguousarray(view[..., :3]) for at, view in window.items()}
            for model in models:
                cells = measure_skipping(load_upscale(model, views), rounds)
                _print_row((model, name, str(size), f"{covered:.3f}", *cells))


def print_full(models: Sequence[str], lenses: Sequence[int], rounds: int) -> None:
    """Prints a row for each size and model, for views of noise."""
    for size in lenses:
        view = np.random.default_rng(0).integers(0, 256, (size, size, 3)).astype(np.uint8)
        views = {(v, u): view for v in range(SIDE) for u in range(SIDE)}
        for model in models:
            _print_row((model, "noise", str(size), "1.000", *measure_skipping(load_upscale(model, views), rounds)))


def print_culling(scenes: dict[str, Scene], lenses: Sequence[int], rounds: int) -> bool:
    """Prints a row for each mesh, array, number of views and backend. Returns whether no row has a mark."""
    all_hold = True
    _print_row(("mesh", "backend", "lenses", "views", "culled", "ms with", "without", "faster", "differs"))
    for name, mesh in scenes.items():
        for size in lenses:
            array = LensArray(size, size, 15, 15)
            placed = mesh.transform(frame_scene(mesh, array))
            for spec in ("center", "cross"):
                views = parse_views(spec, array.pixels_v, array.pixels_u)
                for backend in (open_backend("raytrace")[0], open_backend("raster")[0]):
                    is_done = culling.is_worthwhile(
                        backend.name, triangles=mesh.triangles, rays=size**2, views=len(views)
                    )
                    share, whole, culled, differs = measure_culling(placed, array, views, backend, rounds)
                    holds = not differs and (culled <= SLOWER * whole or not is_done)
                    all_hold &= holds
                    cells = [str(size), str(len(views)), f"{share:.2f}", f"{culled:.1f}", f"{whole:.1f}"]
                    cells += [
                        f"{whole / culled:.2f}",
                        str(differs),
                        "" if is_done else "not done",
                        "" if holds else "!",
                    ]
                    _print_row((name, backend.name, *cells))
    return all_hold


def main(argv: list[str] | None = None) -> int:
    """Prints the tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.skipping", description=main.__doc__)
    parts = ("views", "full", "culling")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts, help="tables (default: all)")
    parser.add_argument("--model", nargs="*", default=MODELS, help=f"names (default {' '.join(MODELS)})")
    parser.add_argument("--lenses", type=int, nargs="*", help="default 100 200 512; for culling 50 100")
    parser.add_argument("--mesh", type=Path, nargs="*", default=[], help="mesh files in addition to the shipped scenes")
    parser.add_argument("--rounds", type=int, default=11, help="times that each row runs (default 11)")
    args = parser.parse_args(argv)
    scenes = {name: load_scene(name) for name in SCENES}
    scenes |= {path.stem: Input(Bundle.from_path(path)).read_mesh(Options()) for path in args.mesh}
    if "views" in args.only:
        print_views(args.model, scenes, args.lenses or (100, 200, 512), args.rounds)
    if "full" in args.only:
        print_full(args.model, args.lenses or (50, 100, 200), args.rounds)
    return int("culling" in args.only and not print_culling(scenes, args.lenses or (50, 100), args.rounds))


def _print_row(cells: Sequence[str]) -> None:
    print(f"{cells[0]:12s}{cells[1]:12s}" + "".join(f"{cell:>9s}" for cell in cells[2:]), flush=True)


if __name__ == "__main__":
    sys.exit(main())
