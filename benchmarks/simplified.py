"""What a simplified copy of a mesh that is much finer than the pixels would gain: why there is none.

    python -m benchmarks.simplified ../shared/data/meshes/koala.obj ../shared/data/meshes/bust-draco.glb [--rounds 5]

The copy is the cheapest there is: vertices of one cell of a grid become one, and triangles that fall together go
(Rossignac and Borrel, 1993). Cells are `--cell` lens pitches wide (1). A job reads the mesh and renders some views
of it; with the copy, it makes that in between. `at best` leaves the making out. Milliseconds are the least of all
rounds, jobs in turns; the error is the root mean square of 8-bit levels of the centre view.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from renderer import inputs
from renderer.backends import open_backend
from renderer.bundle import Bundle
from renderer.framing import frame
from renderer.lens_array import LensArray
from renderer.scene import Part, Scene

if TYPE_CHECKING:
    from renderer.backends import Backend

LENSES = (50, 100)
VIEWS = (1, 45)
PIXELS = 15


def simplified(scene: Scene, cell: float) -> Scene:
    """A scene whose vertices within a cube of side `cell` are one: the first of them."""
    parts = []
    for part in scene.parts:
        cells = np.floor(part.vertices / cell).astype(np.int64)
        cells -= cells.min(axis=0)
        sides = cells.max(axis=0) + 1
        keys = (cells[:, 0] * sides[1] + cells[:, 1]) * sides[2] + cells[:, 2]
        _, first, to = np.unique(keys, return_index=True, return_inverse=True)
        faces = to[part.faces]
        left = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        uv = None if part.uv is None else part.uv[first]
        parts.append(
            Part(
                part.vertices[first], faces[left].astype(np.int32), part.colors[first], uv, part.texture,
                part.alpha_cutoff,
            )
        )  # fmt: skip
    return Scene(tuple(parts), scene.notes)


def times(scene: Scene, array: LensArray, backend: Backend, views: int, cell: float) -> dict[str, float]:
    """Milliseconds of one round of each step after reading."""
    wanted = [divmod(number, PIXELS) for number in range(views)]
    placed = scene.transformed(frame(scene, array))
    spent = {}
    begun = time.perf_counter()
    list(backend.views(placed, array, wanted))
    spent["whole"] = time.perf_counter() - begun
    begun = time.perf_counter()
    copy = simplified(placed, cell * array.pitch)
    spent["simplify"] = time.perf_counter() - begun
    begun = time.perf_counter()
    list(backend.views(copy, array, wanted))
    spent["copy"] = time.perf_counter() - begun
    return {step: 1000 * seconds for step, seconds in spent.items()}


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each mesh, array, number of views and backend."""
    parser = argparse.ArgumentParser(prog="benchmarks.simplified", description=main.__doc__)
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--rounds", type=int, default=5, help="times that each row runs (default 5)")
    parser.add_argument("--cell", type=float, default=1.0, help="side of a cell, lens pitches (default 1)")
    given = parser.parse_args(argv)
    sys.stdout.write(
        f"{'mesh':12s}{'triangles':>11s}{'copy':>8s}{'lenses':>8s}{'views':>6s}  {'backend':9s}{'read':>7s}"
        f"{'whole':>8s}{'simplify':>10s}{'copy':>7s}{'gain':>7s}{'at best':>9s}{'error':>7s}\n"
    )
    for path in given.meshes:
        reads = []
        for _ in range(given.rounds):
            begun = time.perf_counter()
            scene = inputs.read(Bundle.from_path(path), lenses=None, pixels=None)
            reads.append(1000 * (time.perf_counter() - begun))
        if not isinstance(scene, Scene):
            parser.error(f"{path}: not a mesh; name meshes")
        read = min(reads)
        for lenses in LENSES:
            array = LensArray(lenses, lenses, PIXELS, PIXELS)
            placed = scene.transformed(frame(scene, array))
            copy = simplified(placed, given.cell * array.pitch)
            for name in ("raytrace", "raster"):
                backend = open_backend(name)[0]
                one, other = (next(iter(backend.views(each, array, [(7, 7)]))) for each in (placed, copy))
                error = float(np.sqrt(np.mean(np.square(one[..., :3].astype(float) - other[..., :3]))))
                for views in VIEWS:
                    rounds = [times(scene, array, backend, views, given.cell) for _ in range(given.rounds)]
                    whole, simplify, after = (
                        min(one[step] for one in rounds) for step in ("whole", "simplify", "copy")
                    )
                    gain, best = ((read + whole) / (read + made + after) for made in (simplify, 0.0))
                    sys.stdout.write(
                        f"{path.stem:12s}{scene.triangles:11,d}{copy.triangles:8,d}{lenses:8d}{views:6d}  {name:9s}"
                        f"{read:7.1f}{whole:8.1f}{simplify:10.1f}{after:7.1f}{gain:7.2f}{best:9.2f}{error:7.2f}\n"
                    )
                    sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
