"""Measures disparity maps against exact depth, with their time and memory.

    python -m ciir.benchmarks.focus.depth [--meshes ../shared/data/meshes] [--only NAME ...] [--side 512]

`bad`: BadPix(0.07), the share of pixels that are wrong by more than 0.07 pixels a view; `mse`: 100 times the mean
square error (Honauer et al., ACCV 2016: the measures of the HCI 4D light field benchmark, here over all pixels). `MB`:
the peak of the process, and by how much `LightField.disparity` raised it.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.focus.scenes import SIDE, list_scenes, render_exact
from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Map = NDArray[np.float32]

BAD = 0.07
"""Pixels a view by which the disparity of a bad pixel is wrong at least."""
HEAD = f"{'':16s}{'range':>12s}{'bad %':>8s}{'mse x100':>10s}{'seconds':>9s}{'MB':>7s}{'added':>7s}"


def score_map(found: Map, true: Map) -> tuple[float, float]:
    """BadPix(0.07) in percent, and 100 times the mean square error."""
    error = np.abs(found - true)
    return 100 * float((error > BAD).mean()), 100 * float(np.square(error).mean())


def measure_peak(work: Callable[[], None]) -> tuple[int, int]:
    """The peak of this process during `work`, and how far above its start, in MB; 0 where the system doesn't count it.

    Linux counts it in `VmHWM`, which a 5 in `clear_refs` sets back (man 5 proc).
    """
    clear, status = Path("/proc/self/clear_refs"), Path("/proc/self/status")
    if not clear.exists():
        work()
        return 0, 0
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
    args = parser.parse_args(argv)
    names, missing = list_scenes(args.meshes)
    if missing:
        print(f"{args.meshes} has no {', '.join(missing)}: these scenes are left out")
    if unknown := set(args.only or ()) - set(names):
        raise InvalidOption(f"--only: no {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    print(HEAD)
    rows = []
    for name in args.only or names:
        row = _measure(name, args.meshes, args.side)
        print(f"{name:16s}" + _format(row), flush=True)
        rows.append(row)
    print(f"{'mean':16s}" + _format(np.mean(rows, axis=0)))
    return 0


def _measure(name: str, meshes: Path, side: int) -> NDArray[np.float64]:
    """The numbers of a line."""
    scene = render_exact(name, meshes, side=side)
    found, seconds = scene.disparity, 0.0

    def estimate() -> None:
        nonlocal found, seconds
        begun = time.perf_counter()
        found = scene.light_field.disparity().disparity
        seconds = time.perf_counter() - begun

    peak = measure_peak(estimate)
    low, high = scene.disparity.min(), scene.disparity.max()
    return np.array([low, high, *score_map(found, scene.disparity), seconds, *peak])


def _format(row: NDArray[np.float64]) -> str:
    low, high, bad, mse, seconds, peak, added = row
    return f"{low:6.2f}{high:6.2f}{bad:8.1f}{mse:10.2f}{seconds:9.1f}{peak:7.0f}{added:7.0f}"


if __name__ == "__main__":
    sys.exit(main())
