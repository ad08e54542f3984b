"""Elemental image arrays of a mesh by each route: a render for each lens, a render for each view, rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.timing import Stages, Times, in_turns, timed
from ciir.errors import BackendUnavailable
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.light_field import interleave_views
from ciir.renderer.views import parse_views
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.source import Source

ECVIR, OBLIQUE, RAYS = "a perspective render for each lens (ECVIR)", "an oblique render for each view", "Embree's rays"


@dataclass(frozen=True)
class Route:
    """One way to an elemental image array."""

    name: str
    times: Times
    differ: float
    """Share of pixels that differ from those of the rays by more than 3 levels in any channel."""


def routes(source: Source, array: LensArray, options: Options, rounds: int) -> tuple[list[Route], str]:
    """The routes to the array of a mesh, and why one is missing (empty: none is).

    Scene and backends are there; the scene is new to the backend in each round, as it is for a user.
    """
    scene = Input(source).read_mesh(options)
    matrix = frame_scene(scene, array)
    makers: dict[str, Callable[[Scene], NDArray[np.uint8]]] = {}
    missing = ""
    try:
        raster = open_backend("raster")[0]
        every = parse_views("all", array.pixels_v, array.pixels_u)
        makers[ECVIR] = lambda placed: raster.render_by_lens(placed, array)  # type: ignore[attr-defined]  # the raster's own
        makers[OBLIQUE] = lambda placed: interleave_views(raster.render_views(placed, array, every), array)
    except BackendUnavailable as error:
        missing = str(error)
    rays = open_backend("raytrace")[0]
    makers[RAYS] = lambda placed: rays.render_eia(placed, array)

    def job(make: Callable[[Scene], NDArray[np.uint8]]) -> Callable[[], Stages]:
        def run() -> Stages:
            placed = scene.transform(matrix)
            return timed(lambda: make(placed))

        return run

    times = in_turns({name: job(make) for name, make in makers.items()}, rounds, reference=ECVIR)
    placed = scene.transform(matrix)
    exact = makers[RAYS](placed).astype(int)
    found = []
    for name, make in makers.items():
        far = np.abs(make(placed).astype(int) - exact).max(axis=-1) > 3
        found.append(Route(name, times[name], float(far.mean())))
    return found, missing
