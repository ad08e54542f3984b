"""How time grows with lenses, pixels under a lens, triangles, views and threads, and the exponents fitted to that."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.timing import Stages, in_turns, timed
from ciir.errors import BackendUnavailable
from ciir.models import catalogue
from ciir.models.sessions import count_available_cores
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from ciir.renderer.scenes.modelling import revolve
from ciir.renderer.surface import Surface, assemble_scene
from ciir.renderer.writers.formats import FileWriter
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from ciir.renderer.scene import Scene

MESH = "hamburger"
LENSES, PIXELS, VIEWS = (25, 50, 100, 200, 400), (5, 9, 15, 25, 45), (1, 5, 25, 81, 225)
TRIANGLES = (1_000, 10_000, 100_000, 1_000_000, 2_000_000)
QUICK = 3
"""How many of each are looked at in the quick run."""


@dataclass(frozen=True)
class Line:
    """Milliseconds (medians) over one quantity, all else being equal."""

    over: str
    what: str
    counts: tuple[int, ...]
    milliseconds: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Of the power law through the upper half of the counts, where start-up costs weigh least, or through all where
        they are three or fewer; by least squares. NaN of a single count."""
        half = len(self.counts) // 2 if len(self.counts) > 3 else 0
        x, y = np.log(self.counts[half:]), np.log(self.milliseconds[half:])
        return float(np.polyfit(x, y, 1)[0]) if len(x) > 1 else float("nan")


def lines(models: Sequence[str], *, rounds: int, quick: bool) -> Iterator[Line]:
    """Each line in turn; what OpenGL or a network can't do here is left out (the run says what is missing)."""
    most = QUICK if quick else None
    backends = [name for name in ("raster", "raytrace") if _opens(name)]
    views = {f"upscale, {model}": {n: _upscaling(model, n) for n in LENSES[:most]} for model in models} | {
        f"a view by {name}": {n: _rendering(load_scene(MESH), name, n) for n in LENSES[:most]} for name in backends
    }
    yield from _measured("lenses along a side", views, rounds)
    yield from _measured(
        "pixels along a side of an elemental image",
        {f"EIA of 50x50 lenses by {name}": {n: _array(name, n) for n in PIXELS[:most]} for name in backends},
        min(rounds, 3),
    )
    spheres = {n: sphere(n) for n in TRIANGLES[:most]}
    yield from _measured(
        "triangles",
        {
            f"first view of 100x100 by {name}": {n: _rendering(spheres[n], name, 100) for n in spheres}
            for name in backends
        },
        min(rounds, 3),
    )
    yield from _measured(
        "views",
        {f"whole job, 50x50 lenses, {model}": {n: _views(model, n) for n in VIEWS[:most]} for model in models[:1]},
        min(rounds, 3),
    )
    cores = range(1, count_available_cores() + 1)
    yield from _measured(
        "threads",
        {f"upscale 200x200, {model}": {n: _upscaling(model, 200, threads=n) for n in cores} for model in models},
        rounds,
    )


def _opens(name: str) -> bool:
    try:
        open_backend(name)
    except BackendUnavailable:
        return False
    return True


def _measured(over: str, jobs: Mapping[str, Mapping[int, Callable[[], Stages]]], rounds: int) -> Iterator[Line]:
    """All jobs of one quantity take turns with each other."""
    flat = {f"{what}\n{count}": job for what, line in jobs.items() for count, job in line.items()}
    times = in_turns(flat, rounds)
    for what, line in jobs.items():
        if line:
            medians = tuple(times[f"{what}\n{count}"].median for count in line)
            yield Line(over, what, tuple(line), medians)


def _upscaling(model: str, lenses: int, threads: int | None = None) -> Callable[[], Stages]:
    image = np.random.default_rng(lenses).random((1, 3, lenses, lenses), dtype=np.float32)
    network = catalogue.load_upscaler(model, threads=threads)
    return lambda: timed(lambda: network(image))


def _rendering(mesh: Scene, backend: str, lenses: int) -> Callable[[], Stages]:
    """One view of a mesh that the backend hasn't seen yet: what a job waits for."""
    array = LensArray(lenses, lenses, 15, 15)
    matrix = frame_scene(mesh, array)
    renderer = open_backend(backend)[0]

    def run() -> Stages:
        placed = mesh.transform(matrix)
        return timed(lambda: list(renderer.render_views(placed, array, [(7, 7)])))

    return run


def _array(backend: str, pixels: int) -> Callable[[], Stages]:
    array = LensArray(50, 50, pixels, pixels)
    matrix = frame_scene(load_scene(MESH), array)
    renderer = open_backend(backend)[0]

    def run() -> Stages:
        placed = load_scene(MESH).transform(matrix)
        return timed(lambda: renderer.render_eia(placed, array))

    return run


def _views(model: str, count: int) -> Callable[[], Stages]:
    pairs = ";".join(f"{v},{u}" for v, u in (divmod(number, 15) for number in range(count)))
    options = Options(lenses=(50, 50), pixels=(15, 15), views=pairs, model=model)
    return lambda: timed(lambda: reconstruct(MESH, options, FileWriter(io.BytesIO(), "zip")))


def sphere(triangles: int) -> Scene:
    """A sphere of about as many triangles, plain."""
    segments = max(8, round((triangles / 2) ** 0.5 * 1.42))
    angle = np.linspace(-np.pi / 2, np.pi / 2, max(3, round(triangles / 2 / segments) + 1))
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    vertices, faces, _ = revolve(profile, segments)
    return assemble_scene(
        [Surface(vertices, faces, color=(0.8, 0.6, 0.3, 1.0))], name=f"sphere of {len(faces)} triangles"
    )
