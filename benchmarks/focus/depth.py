"""Compares disparity maps with exact depth, and measures their time and memory.

    python -m ciir.benchmarks.focus.depth [--meshes ../shared/data/meshes] [--only NAME ...] [--side 512] [--noise 10]
    python -m ciir.benchmarks.focus.depth --upscale [--meshes ...] [--only NAME ...] [--side 256]

`bad`: BadPix(0.07), the share of pixels that are wrong by more than 0.07 pixels per view. `mse`: 100 times the mean
square error (Honauer et al., ACCV 2016: the measures of the HCI 4D light field benchmark, here over all pixels). `MB`:
the peak of the process, and how much `LightField.disparity` raised it.

`--upscale` compares the disparity of views upscaled to `--side` pixels by the default with that of views of half the
side, doubled in size by linear interpolation. It also gives the PSNR of the plane at the median disparity against that
of the exact views: for the plane of the small views, doubled in size by cubic interpolation, and for the plane of the
upscaled views.
"""

from __future__ import annotations

import argparse
import ctypes
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir import upscale
from ciir.benchmarks.focus.scenes import SIDE, list_scenes, render_exact
from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.training.evaluation.metrics import score_map

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Map = NDArray[np.float32]

HEAD = f"{'':16s}" + "".join(f"{word:>9s}" for word in ("least", "most", "bad %", "mse", "seconds", "MB", "added"))
_UPSCALED = ("bad %", "mse", "upscaled", "mse", "plane dB", "upscaled")
HEAD_UPSCALED = f"{'':16s}" + "".join(f"{word:>9s}" for word in _UPSCALED)


def _score(found: Map, true: Map) -> tuple[float, float]:
    """Returns BadPix(0.07) in percent, and 100 times the mean square error."""
    score = score_map(found, true)
    return 100 * score.bad, score.mse


def measure_peak(work: Callable[[], None]) -> tuple[int, int]:
    """Returns the peak of this process during `work`, and how far that is above its start, in MB; 0 if the system
    doesn't count it.

    Linux counts it in `VmHWM`, which a 5 in `clear_refs` resets (man 5 proc). Memory that is free, but kept for the
    next call, is given back first.
    """
    clear, status = Path("/proc/self/clear_refs"), Path("/proc/self/status")
    if not clear.exists():
        work()
        return 0, 0
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc has it
    if trim is not None:
        trim(0)
    clear.write_text("5")

    def read_peak() -> int:
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) >> 10

    before = read_peak()
    work()
    return read_peak(), read_peak() - before


def main(argv: list[str] | None = None) -> int:
    """Prints a line for each scene, and the mean."""
    parser = argparse.ArgumentParser(prog="benchmarks.focus.depth", description=main.__doc__)
    parser.add_argument("--meshes", type=Path, default=Path("../shared/data/meshes"), help="folder of meshes")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="some of the scenes")
    parser.add_argument("--side", type=int, default=SIDE, help="pixels along each side of a view")
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation in 8-bit levels, in every view")
    parser.add_argument("--upscale", action="store_true", help="compare with upscaled views")
    args = parser.parse_args(argv)
    names, missing = list_scenes(args.meshes)
    if missing:
        print(f"{args.meshes} has no {', '.join(missing)}: these scenes are left out")
    if unknown := set(args.only or ()) - set(names):
        raise InvalidOption(f"--only: no {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    print(HEAD_UPSCALED if args.upscale else HEAD)
    rows = []
    for name in args.only or names:
        if args.upscale:
            row = _measure_upscaled(name, args.meshes, args.side)
        else:
            row = _measure(name, args.meshes, args.side, args.noise)
        print(f"{name:16s}" + _format(row), flush=True)
        rows.append(row)
    print(f"{'mean':16s}" + _format(np.mean(rows, axis=0)))
    return 0


def _measure_upscaled(name: str, meshes: Path, side: int) -> NDArray[np.float64]:
    """Returns the numbers of a line of `--upscale`."""
    small = render_exact(name, meshes, side=side // 2).light_field
    exact = render_exact(name, meshes, side=side)
    large, middle = upscale(small), float(np.median(exact.disparity))
    plain = 2 * ndimage.zoom(small.disparity().disparity, 2, order=1, mode="nearest", grid_mode=True)
    plane = ndimage.zoom(small.refocus(middle / 2), (2, 2, 1), order=3, mode="nearest", grid_mode=True)
    scores = [*_score(plain, exact.disparity), *_score(large.disparity().disparity, exact.disparity)]
    truth = exact.light_field.refocus(middle).astype(np.float32)
    planes = [10 * np.log10(255**2 / np.square(found - truth).mean()) for found in (plane, large.refocus(middle))]
    return np.array([*scores, *planes])


def _measure(name: str, meshes: Path, side: int, noise: float) -> NDArray[np.float64]:
    """Returns the numbers of a line."""
    scene = render_exact(name, meshes, side=side)
    views = scene.light_field.views
    if noise:
        added = noise * np.random.default_rng(0).standard_normal(views.shape, np.float32)
        views = (views + added).round().clip(0, 255).astype(np.uint8)
    light_field = LightField(views)
    found, seconds = scene.disparity, 0.0

    def estimate() -> None:
        nonlocal found, seconds
        begun = time.perf_counter()
        found = light_field.disparity().disparity
        seconds = time.perf_counter() - begun

    peak = measure_peak(estimate)
    low, high = scene.disparity.min(), scene.disparity.max()
    return np.array([low, high, *_score(found, scene.disparity), seconds, *peak])


def _format(row: NDArray[np.float64]) -> str:
    upscaled = (".1f", ".2f", ".1f", ".2f", ".2f", ".2f")
    widths = upscaled if len(row) == len(upscaled) else (".2f", ".2f", ".1f", ".2f", ".1f", ".0f", ".0f")
    return "".join(f"{number:9{width}}" for number, width in zip(row, widths, strict=True))


if __name__ == "__main__":
    sys.exit(main())
