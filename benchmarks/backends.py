"""Milliseconds for a view by each backend, over triangles and lenses: what `--backend auto` goes by.

    python -m benchmarks.backends [--rounds 5] [--views 45]

A job is what the pipeline does: a scene that the backend has not seen yet, and some views of it. Backends take turns in
one process, with OpenGL running. The last column is what `auto` takes; a `!` marks where the other was faster.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time

from renderer.backends import open_backend
from renderer.framing import frame
from renderer.lens_array import LensArray
from renderer.scenes import SCENES, scene

LENSES = (25, 50, 100, 200, 400)


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each shipped scene and lens count."""
    parser = argparse.ArgumentParser(prog="benchmarks.backends", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="times that each row runs (default 5)")
    parser.add_argument("--views", type=int, default=45, help="views of a job, 1 to 225 (default 45)")
    given = parser.parse_args(argv)
    views = [divmod(number, 15) for number in range(given.views)]
    backends = [open_backend(name)[0] for name in ("raster", "raytrace")]
    sys.stdout.write("scene        triangles   lenses    raster  raytrace   auto   (median ms a view)\n")
    for name in SCENES:
        for lenses in LENSES:
            array = LensArray(lenses, lenses, 15, 15)
            matrix, triangles = frame(scene(name), array), scene(name).triangles
            times: dict[str, list[float]] = {backend.name: [] for backend in backends}
            for _ in range(given.rounds + 1):
                for backend in backends:
                    placed = scene(name).transformed(matrix)
                    begun = time.perf_counter()
                    list(backend.views(placed, array, views))
                    times[backend.name].append(1000 * (time.perf_counter() - begun) / len(views))
            raster, raytrace = (statistics.median(times[key][1:]) for key in ("raster", "raytrace"))
            taken = open_backend("auto", triangles=triangles, rays=lenses**2)[0].name
            best = "raster" if raster < raytrace else "raytrace"
            sys.stdout.write(
                f"{name:12s} {triangles:9,d} {lenses:4d}x{lenses:<4d} {raster:8.2f}  {raytrace:8.2f}   "
                f"{taken}{'' if taken == best else ' !'}\n"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
