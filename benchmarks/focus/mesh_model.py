"""Measures models of meshes (`ciir depth MESH -o model.glb`): views of the model against those of the mesh, turned.

    python -m ciir.benchmarks.focus.mesh_model [--meshes ../shared/data/meshes] [--only NAME ...] [--rotate 150]

Prints the PSNR, dB, of the centre view of 300x300 lenses, of 2x2 rays each, over the colour `8080ff`, with both turned
to the right about the middle of the mesh by some degrees.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends import open_backend
from ciir.renderer.lens_array import LensArray
from ciir.service.pipeline.focus.models import build_model
from ciir.service.pipeline.options import KINDS
from ciir.service.pipeline.source import Input, open_source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.scene import Scene

TURNS = (0, 20, 40)
LENSES = 300
BACKGROUND = (128, 128, 255)


def main(argv: list[str] | None = None) -> int:
    """Prints a line for each mesh."""
    parser = argparse.ArgumentParser(prog="benchmarks.focus.mesh_model", description=main.__doc__)
    parser.add_argument("--meshes", type=Path, default=Path("../shared/data/meshes"), help="folder of meshes")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these meshes")
    parser.add_argument("--rotate", default="0", help="as that of ciir depth (default 0)")
    args = parser.parse_args(argv)
    print(f"{'':16s}" + "".join(f"{f'{turn} degrees':>12s}" for turn in TURNS))
    for path in sorted(args.meshes.iterdir()):
        if args.only is None or path.stem in args.only:
            print(f"{path.stem:16s}" + "".join(f"{psnr:12.1f}" for psnr in _measure(path, args.rotate)), flush=True)
    return 0


def _measure(path: Path, rotate: str) -> list[float]:
    """Returns the PSNR at each of `TURNS`."""
    options = KINDS["disparity"].parse({"rotate": rotate})
    model, report = build_model(open_source(str(path)), options)
    mesh = Input(open_source(str(path))).read_mesh(options).transform(np.array(report["scene_transform"]))
    array = LensArray(LENSES, LENSES, 1, 1, model.array.width / LENSES)
    middle = mesh.bounds().mean(axis=0)
    found = []
    for turn in np.radians(TURNS):
        matrix = np.eye(4)
        matrix[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        matrix[:3, 3] = middle - matrix[:3, :3] @ middle
        shown, true = (_render(scene.transform(matrix), array) for scene in (model.scene(), mesh))
        found.append(10 * float(np.log10(255**2 / np.square(shown - true).mean())))
    return found


def _render(scene: Scene, array: LensArray) -> NDArray[np.float32]:
    """Renders the centre view, RGB in 8-bit levels."""
    rays = LENSES**2 * 4
    backend, _ = open_backend("raytrace", triangles=scene.triangles, rays=rays, is_see_through=scene.is_see_through)
    (view,) = backend.render_views(scene, array, [(0, 0)], samples=2, background=BACKGROUND)
    return view[..., :3].astype(np.float32)


if __name__ == "__main__":
    sys.exit(main())
