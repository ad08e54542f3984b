"""Measures models of captured scenes: mesh -> elemental image array -> model as GLB -> elemental image array.

    python -m ciir.benchmarks.focus.model [--meshes ../shared/data/meshes] [--only NAME ...] [--lenses 100]
                                          [--pixels 15] [--sampling pinhole|lenslet]

- `mean`, `worst`: PSNR in dB over all views that the model is made from, and of the worst of them.
- `between`: PSNR over the views half way between them, which the model is not made from.
- `moved`: PSNR there of the mesh itself, moved right and up by a tenth of a pixel. It shows what sampling alone makes
  of so small an error.
- `median`, `95 %`: how much the disparity of the model's surface differs from the mesh's, over the lenses of the centre
  view that see both.
- `seconds`: the time of `LightField.model`.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, get_args

import numpy as np

import ciir
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.renderer.views import center_view
from ciir.service.pipeline.options import Options, Sampling
from ciir.service.pipeline.source import Input, open_source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene

HEAD = (
    f"{'':16s}{'mean dB':>9s}{'worst':>7s}{'between':>9s}{'moved':>8s}{'median':>8s}{'95 %':>7s}"
    f"{'triangles':>11s}{'seconds':>9s}"
)


def main(argv: list[str] | None = None) -> int:
    """Prints a line for each mesh."""
    parser = argparse.ArgumentParser(prog="benchmarks.focus.model", description=main.__doc__)
    parser.add_argument("--meshes", type=Path, default=Path("../shared/data/meshes"), help="folder of meshes")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these meshes")
    parser.add_argument("--lenses", type=int, default=100, help="lenses along each side of the array")
    parser.add_argument("--pixels", type=int, default=15, help="pixels along each side under a lens")
    parser.add_argument("--sampling", choices=get_args(Sampling), default="pinhole", help="sampling of both arrays")
    args = parser.parse_args(argv)
    print(HEAD)
    for path in sorted(args.meshes.iterdir()):
        if args.only is None or path.stem in args.only:
            row = _measure(path, args.lenses, args.pixels, args.sampling)
            print("{:16s}{:9.2f}{:7.2f}{:9.2f}{:8.2f}{:8.3f}{:7.3f}{:11,}{:9.1f}".format(path.stem, *row), flush=True)
    return 0


def _measure(
    path: Path, lenses: int, pixels: int, sampling: Sampling
) -> tuple[float, float, float, float, float, float, int, float]:
    """Returns the numbers of a line."""
    render = partial(ciir.render, lenses=(lenses, lenses), pixels=(pixels, pixels), sampling=sampling)
    captured = render(path)
    begun = time.perf_counter()
    model = captured.model()
    seconds = time.perf_counter() - begun
    with TemporaryDirectory() as folder:
        file = Path(folder) / "model.glb"
        model.save(file)
        again = render(file, fit="none")
    errors = np.square(captured.views.astype(np.float32) - again.views).mean(axis=(2, 3, 4))
    mesh = Input(open_source(str(path))).read_mesh(Options())
    placed = mesh.transform(frame_scene(mesh, model.array))
    between = replace(model.array, pixels_v=pixels - 1, pixels_u=pixels - 1)
    step = np.eye(4)
    step[:2, 3] = 0.1 * model.array.pitch
    unseen, shown, moved = (
        _render(scene, between, sampling) for scene in (placed, model.scene(), placed.transform(step))
    )
    true, found = (_find_disparity(scene, model.array) for scene in (placed, model.scene()))
    both = np.isfinite(true) & np.isfinite(found)
    median, most = np.quantile(np.abs(true[both] - found[both]), (0.5, 0.95))
    held_out, shaken = (_to_psnr(np.square(unseen - other).mean()) for other in (shown, moved))
    return _to_psnr(errors.mean()), _to_psnr(errors.max()), held_out, shaken, median, most, len(model.faces), seconds


def _to_psnr(error: np.floating) -> float:
    return 10 * float(np.log10(255**2 / error))


def _render(scene: Scene, array: LensArray, sampling: Sampling) -> NDArray[np.float32]:
    """Renders the elemental image array of a scene in place, RGB in 8-bit levels."""
    rays = array.rows * array.cols * array.pixels_v * array.pixels_u
    backend, _ = open_backend("raytrace", triangles=scene.triangles, rays=rays, is_see_through=False)
    samples = LENSLET_SAMPLES if sampling == "lenslet" else 1
    return backend.render_eia(scene, array, samples=samples)[..., :3].astype(np.float32)


def _find_disparity(scene: Scene, array: LensArray) -> NDArray[np.float32]:
    """Returns the disparity of the centre view, `(rows, cols)`, in pixels per view; infinite where nothing is seen."""
    backend, _ = open_backend("raytrace", triangles=scene.triangles, rays=array.rows * array.cols, is_see_through=False)
    (depth,) = backend.render_depth(scene, array, [center_view(array.pixels_v, array.pixels_u)])
    return depth * np.float32(array.delta / array.pitch)


if __name__ == "__main__":
    sys.exit(main())
