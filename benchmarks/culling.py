"""What culling wins before a mesh's views are rendered, and whether it changes any pixel.

    python -m benchmarks.culling ../shared/data/meshes/*.obj ../shared/data/meshes/*.glb [--always] [--rounds 9]

One or five views (`center`, `cross`) of each mesh, and of the shipped scenes, by both backends, with and without
culling in turns within one process; milliseconds are the least of all rounds, culling counted. `culled`: the share of
triangles; `differs`: pixels that are not the same. Rows are those in which `renderer.culling.pays`; `--always` culls in
all others too, which shows what its rule leaves out. `!` marks a pixel that differs, or a row that pays and is over 3 %
slower; the exit status is 1 then.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from renderer import culling
from renderer.backends import open_backend
from renderer.bundle import Bundle
from renderer.framing import frame
from renderer.lens_array import LensArray
from renderer.scenes import SCENES, scene
from renderer.views import parse_views
from service.request import Options
from service.source import Input

if TYPE_CHECKING:
    from collections.abc import Sequence

    from renderer.backends import Backend
    from renderer.scene import Scene
    from renderer.views import View

LENSES = (50, 100)
PIXELS = 15
WANTED = ("center", "cross")
SLOWER = 1.03
"""How many times as long views may take by culling."""


class Row(NamedTuple):
    """Some views of a mesh, with and without culling."""

    culled: float
    """Share of the triangles."""
    whole: float
    """Milliseconds."""
    left: float
    """Milliseconds, culling included."""
    differs: int
    """Pixels."""


def measured(placed: Scene, array: LensArray, views: Sequence[View], backend: Backend, rounds: int) -> Row:
    """Both in turns; of each round the scene is new to the backend. The first round doesn't count."""
    times: dict[bool, list[float]] = {False: [], True: []}
    made, share, differs = {}, 0.0, 0
    for _ in range(rounds + 1):
        for culls in (False, True):
            found = replace(placed)
            begun = time.perf_counter()
            if culls:
                found = culling.needed(found, array, views)
            made[culls] = np.stack(list(backend.views(found, array, views)))
            times[culls].append(1000 * (time.perf_counter() - begun))
            share = 1 - found.triangles / placed.triangles
        differs = max(differs, int((made[False] != made[True]).any(axis=-1).sum()))
    return Row(share, min(times[False][1:]), min(times[True][1:]), differs)


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each mesh, array, number of views and backend."""
    parser = argparse.ArgumentParser(prog="benchmarks.culling", description=main.__doc__)
    parser.add_argument("meshes", type=Path, nargs="*", help="files beside the shipped scenes")
    parser.add_argument("--lenses", type=int, nargs="+", default=LENSES, help="along each side (default 50 100)")
    parser.add_argument("--rounds", type=int, default=9, help="times that each row runs (default 9)")
    parser.add_argument("--always", action="store_true", help="cull where it doesn't pay too")
    given = parser.parse_args(argv)
    meshes = {name: scene(name) for name in SCENES}
    meshes |= {path.stem: Input(Bundle.from_path(path)).read_mesh(Options()) for path in given.meshes}
    kept = True
    sys.stdout.write(
        f"{'mesh':12s}{'triangles':>10s}{'lenses':>7s}{'views':>6s}  {'backend':9s}{'culled':>7s}{'whole':>8s}"
        f"{'left':>8s}{'faster':>7s}{'differs':>8s}\n"
    )
    for name, mesh in meshes.items():
        for lenses in given.lenses:
            array = LensArray(lenses, lenses, PIXELS, PIXELS)
            placed = mesh.transformed(frame(mesh, array))
            for wanted in WANTED:
                views = parse_views(wanted, PIXELS, PIXELS)
                for backend in (open_backend("raytrace")[0], open_backend("raster")[0]):
                    is_worth = culling.pays(backend.name, triangles=mesh.triangles, rays=lenses**2, views=len(views))
                    if not is_worth and not given.always:
                        continue
                    row = measured(placed, array, views, backend, given.rounds)
                    holds = not row.differs and (row.left <= SLOWER * row.whole or not is_worth)
                    kept &= holds
                    sys.stdout.write(
                        f"{name:12s}{mesh.triangles:10,d}{lenses:7d}{len(views):6d}  {backend.name:9s}{row.culled:7.2f}"
                        f"{row.whole:8.1f}{row.left:8.1f}{row.whole / row.left:7.2f}{row.differs:8d}"
                        f"{'' if is_worth else ' (not culled)'}{'' if holds else ' !'}\n"
                    )
                    sys.stdout.flush()
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
