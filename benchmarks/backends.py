"""Milliseconds for a view by each backend, over triangles and lenses: what `--backend auto` goes by.

    python -m benchmarks.backends [--rounds 5]

Backends take turns in one process. The last column is what `auto` takes; a `!` marks where the other was faster.
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

VIEWS = [(v, 7) for v in range(5)]
LENSES = (25, 50, 100, 200, 400)


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each shipped scene and lens count."""
    parser = argparse.ArgumentParser(prog="benchmarks.backends", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="times that each row runs (default 5)")
    rounds = parser.parse_args(argv).rounds
    backends = [open_backend(name)[0] for name in ("raster", "raytrace")]
    sys.stdout.write("scene        triangles   lenses    raster  raytrace   auto   (median ms a view)\n")
    for name in SCENES:
        for lenses in LENSES:
            array = LensArray(lenses, lenses, 15, 15)
            placed = scene(name).transformed(frame(scene(name), array))
            times: dict[str, list[float]] = {backend.name: [] for backend in backends}
            for _ in range(rounds + 1):
                for backend in backends:
                    begun = time.perf_counter()
                    list(backend.views(placed, array, VIEWS))
                    times[backend.name].append(1000 * (time.perf_counter() - begun) / len(VIEWS))
            raster, raytrace = (statistics.median(times[key][1:]) for key in ("raster", "raytrace"))
            taken = open_backend("auto", triangles=placed.triangles, rays=lenses**2)[0].name
            best = "raster" if raster < raytrace else "raytrace"
            sys.stdout.write(
                f"{name:12s} {placed.triangles:9,d} {lenses:4d}x{lenses:<4d} {raster:8.2f}  {raytrace:8.2f}   "
                f"{taken}{'' if taken == best else ' !'}\n"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
