"""What exact skipping gains: of views, and of the triangles of a mesh (culling).

    python -m ciir.benchmarks.skipping [--model NAME ...] [--lenses 100 200 512] [--mesh FILE ...] [--rounds 11]
        [--only views|full|culling ...]

`views`: middle views of the shipped scenes, through the upscale stage alone, with and without skipping, in turns within
one process; times are medians, and how much faster is the median over rounds of the ratio of the two.
`covered` is the share of the view with alpha > 0, `box` that of the object's bounding box, `seen` that which went
through the network, halo included. `differs`: levels of 255, at most; 0 for int8 networks. `full`: views without
background, of which nothing can be left out: with corners that differ, found at once, and with corners alike;
`costs` is how much longer they took.

`culling`: one view and five (`cross`) of each mesh by both backends, with and without culling, which is counted; the
least of all rounds. `culled` is the share of triangles. Culling is forced where it is not worthwhile
(`renderer.backends.culling.is_worthwhile`), and the row says so; `!` marks pixels that differ, and rows in which it is
done and takes over 3 % longer.

A network that sees r far needs 2*r around what differs, as it has zeros around what it is given: of 100x100 pixels with
r = 8, a third of each side. What else was tried, all of it the same to the bit with `fast-int8`:

- edge pixels repeated before every layer in place of zeros. Around the object all features are constant, so r is
  enough; but onnxruntime's `Pad` took as much time as the smaller box won;
- that before every second or fourth layer, and no padding in between. It wins, least on large views, but takes a second
  file for each network, and where the object is nearer than 2*r to an edge of the view that axis needs the zeros;
- boxes cut in two along rows or columns where that saves enough, which
  `models.single.skipping.cover_with_boxes` does: the globe at 512 lenses gains; at 100 and 200 the halo
  that a cut adds costs what it saves.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.backends import culling, open_backend
from ciir.renderer.backends.embree import RaytraceBackend
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

    View = NDArray[np.uint8]
    Upscale = Callable[[bool, SkipStatistics], NDArray[np.uint8]]

MODELS = ("fast-int8", "field-int8")
MIDDLE, SIDE = 7, 5
"""Of 15x15 views, the one that is upscaled; and the window around it, for light-field networks."""
FULL = (50, 100, 200)
"""Sizes of the views without background."""
PIXELS = 400 * 400
"""Small views take so many more rounds, up to 20 times, that as many pixels go through them."""
SLOWER = 1.03
"""How many times as long views may take with culling."""


class Row(NamedTuple):
    """One view, with and without skipping."""

    skipping: float
    """Milliseconds, median."""
    whole: float
    skipped_pixels: SkipStatistics
    ratio: float
    """How many times faster skipping is: median over rounds."""
    differs: int

    @property
    def seen(self) -> float:
        """Share of the view that went through the network."""
        return 1 - (self.skipped_pixels.uniform + self.skipped_pixels.repeated) / self.skipped_pixels.pixels


def measured(upscale: Upscale, rounds: int) -> Row:
    """Both in turns, each first in every other round; the first round of each doesn't count."""
    skipped_pixels = SkipStatistics()
    pair = [upscale(True, skipped_pixels).astype(int), upscale(False, SkipStatistics()).astype(int)]
    times: dict[bool, list[float]] = {True: [], False: []}
    for number in range(rounds):
        for is_skipping in (number % 2 == 0, number % 2 == 1):
            begun = time.perf_counter()
            upscale(is_skipping, SkipStatistics())
            times[is_skipping].append(1000 * (time.perf_counter() - begun))
    skipped, whole = (statistics.median(times[key]) for key in (True, False))
    ratio = statistics.median(slow / quick for quick, slow in zip(times[True], times[False], strict=True))
    return Row(skipped, whole, skipped_pixels, ratio, int(np.abs(pair[0] - pair[1]).max()))


def upscaler(name: str, views: dict[tuple[int, int], View]) -> Upscale:
    """What model `name` makes of the middle one of `SIDE` x `SIDE` views `(H, W, 3)`; it opens the model."""
    middle = (SIDE // 2, SIDE // 2)
    if next(entry for entry in catalogue.list_entries() if entry.name == name).is_light_field:
        network, alone = catalogue.load_light_field_network(name), catalogue.load_upscaler(catalogue.DEFAULT)

        def together(skipping: bool, skipped_pixels: SkipStatistics) -> NDArray[np.uint8]:
            made, _ = upscale_views(
                network, alone, views, [middle], (SIDE, SIDE), skip=skipping, statistics=skipped_pixels
            )
            return made.astype(np.uint8)

        return together
    model, picture = catalogue.load_upscaler(name), np.ascontiguousarray(views[middle][np.newaxis])
    return lambda skipping, skipped_pixels: upscale_pixels(model, picture, skip=skipping, statistics=skipped_pixels)


def rendered(mesh: Scene, lenses: int) -> dict[tuple[int, int], View]:
    """RGBA views of the window about the middle one, `(lenses, lenses, 4)`, numbered from 0."""
    array = LensArray(lenses, lenses, 15, 15)
    low = MIDDLE - SIDE // 2
    at = [(v, u) for v in range(low, low + SIDE) for u in range(low, low + SIDE)]
    made = RaytraceBackend().render_views(mesh.transform(frame_scene(mesh, array)), array, at, samples=1)
    return {(v - low, u - low): view for (v, u), view in zip(at, made, strict=True)}


def shares(view: View) -> tuple[float, float]:
    """Of an RGBA view: the share that the object covers, and that of its bounding box."""
    covered = view[..., 3] > 0
    sides = [np.ptp(np.flatnonzero(covered.any(axis=axis))) + 1 for axis in (0, 1)] if covered.any() else [0, 0]
    return float(covered.mean()), float(sides[0] * sides[1] / covered.size)


def full(size: int, *, alike: bool) -> dict[tuple[int, int], View]:
    """Views of noise, `(size, size, 3)`; `alike`: with black corners."""
    random = np.random.default_rng(0)
    view = random.integers(1, 256, (size, size, 3)).astype(np.uint8)
    if alike:
        view[:: size - 1, :: size - 1] = 0
    return {(v, u): view for v in range(SIDE) for u in range(SIDE)}


class Culled(NamedTuple):
    """Some views of a mesh, with and without culling."""

    share: float
    """Of the triangles."""
    whole: float
    """Milliseconds, as `left`, which includes culling."""
    left: float
    differs: int
    """Pixels."""


def culled(placed: Scene, array: LensArray, wanted: str, backend: Backend, rounds: int) -> Culled:
    """Both in turns, the scene new to the backend each time; the first round doesn't count."""
    views = parse_views(wanted, array.pixels_v, array.pixels_u)
    times: dict[bool, list[float]] = {False: [], True: []}
    made, share, differs = {}, 0.0, 0
    for _ in range(rounds + 1):
        for is_culling in (False, True):
            found = replace(placed)
            begun = time.perf_counter()
            if is_culling:
                found = culling.cull_scene(found, array, views)
            made[is_culling] = np.stack(list(backend.render_views(found, array, views)))
            times[is_culling].append(1000 * (time.perf_counter() - begun))
            share = 1 - found.triangles / placed.triangles
        differs = max(differs, int((made[False] != made[True]).any(axis=-1).sum()))
    return Culled(share, min(times[False][1:]), min(times[True][1:]), differs)


def show_views(models: Sequence[str], scenes: dict[str, Scene], lenses: Sequence[int], rounds: int) -> None:
    """A row for each scene, size and model."""
    _write(("model", "scene", "lenses", "covered", "box", "seen", "ms with", "without", "faster", "differs"))
    for name, mesh in scenes.items():
        for size in lenses:
            seen = rendered(mesh, size)
            covered, box = shares(seen[SIDE // 2, SIDE // 2])
            views = {at: np.ascontiguousarray(view[..., :3]) for at, view in seen.items()}
            for model in models:
                row = measured(upscaler(model, views), _rounds(rounds, size))
                words = [f"{value:.3f}" for value in (covered, box, row.seen)]
                words += [f"{row.skipping:.1f}", f"{row.whole:.1f}", f"{row.ratio:.2f}", str(row.differs)]
                _write((model, name, str(size), *words))


def show_full(models: Sequence[str], sizes: Sequence[int], rounds: int) -> None:
    """A row for each view without background, and model."""
    _write(("model", "corners", "pixels", "ms with", "without", "costs"))
    for size in sizes:
        for alike in (False, True):
            for model in models:
                row = measured(upscaler(model, full(size, alike=alike)), _rounds(rounds, size))
                costs = (f"{row.skipping:.2f}", f"{row.whole:.2f}", f"{100 / row.ratio - 100:+.1f} %")
                _write((model, "alike" if alike else "differ", str(size), *costs))


def show_culling(scenes: dict[str, Scene], lenses: Sequence[int], rounds: int) -> bool:
    """A row for each mesh, array, number of views and backend; whether no row has a mark."""
    holds = True
    _write(("mesh", "backend", "lenses", "views", "culled", "whole", "left", "faster", "differs"))
    for name, mesh in scenes.items():
        for size in lenses:
            array = LensArray(size, size, 15, 15)
            placed = mesh.transform(frame_scene(mesh, array))
            for wanted, count in (("center", 1), ("cross", 5)):
                for backend in (open_backend("raytrace")[0], open_backend("raster")[0]):
                    pays = culling.is_worthwhile(backend.name, triangles=mesh.triangles, rays=size**2, views=count)
                    row = culled(placed, array, wanted, backend, rounds)
                    kept = not row.differs and (row.left <= SLOWER * row.whole or not pays)
                    holds &= kept
                    words = [str(size), str(count), f"{row.share:.2f}", f"{row.whole:.1f}", f"{row.left:.1f}"]
                    words += [f"{row.whole / row.left:.2f}", str(row.differs)]
                    _write((name, backend.name, *words, *(() if pays else (" left out",)), *(() if kept else (" !",))))
    return holds


def main(argv: list[str] | None = None) -> int:
    """Prints the tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.skipping", description=main.__doc__)
    parts = ("views", "full", "culling")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts, help="tables (default: all)")
    parser.add_argument("--model", nargs="*", default=MODELS, help=f"names (default {' '.join(MODELS)})")
    parser.add_argument(
        "--lenses", type=int, nargs="*", help="along each side (default 100 200 512; of culling 50 100)"
    )
    parser.add_argument("--full", type=int, nargs="*", default=FULL, help="sides of the views without background")
    parser.add_argument("--mesh", type=Path, nargs="*", default=[], help="mesh files beside the shipped scenes")
    parser.add_argument("--rounds", type=int, default=11, help="times that each row runs at least (default 11)")
    given = parser.parse_args(argv)
    scenes = {name: load_scene(name) for name in SCENES}
    scenes |= {path.stem: Input(Bundle.from_path(path)).read_mesh(Options()) for path in given.mesh}
    if "views" in given.only:
        show_views(given.model, scenes, given.lenses or (100, 200, 512), given.rounds)
    if "full" in given.only:
        show_full(given.model, given.full, given.rounds)
    return int("culling" in given.only and not show_culling(scenes, given.lenses or (50, 100), given.rounds))


def _rounds(given: int, size: int) -> int:
    return int(given * min(20, max(1, PIXELS // size**2)))


def _write(words: Sequence[str]) -> None:
    sys.stdout.write(f"{words[0]:12s}{words[1]:12s}" + "".join(f"{word:>9s}" for word in words[2:]) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
