"""Compares the time of depth planes with plain numpy and plenopticam, and measures how it grows.

    python -m ciir.benchmarks.focus.planes [--plenopticam PYTHON] [--rounds 5]

PYTHON: the interpreter of an environment of its own that has plenopticam from PyPI. In each round each method refocuses
the same views. Times are medians, and ratios are medians of the ratios within rounds, because other processes slow down
all methods alike. `cpu`: seconds of processor time, over all threads. `error`: RMS in 8-bit levels of the plane that is
in focus, against the exact picture, away from borders.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, cast

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.focus.kernels import REACH, make_sinc_taps
from ciir.renderer.focus.planes import refocus

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Planes = NDArray[np.floating]
    Timed = tuple[float, float, Planes]
    """Seconds of processor time and of wall time, and the planes."""
    _Tap = tuple[np.float32, slice, slice]

HEAD = f"{'':14s}{'cpu':>8s}{'wall':>8s}{'x cpu':>8s}{'x wall':>8s}{'error':>8s}"
BORDER = 0.25
"""The share of a side that is not compared, because methods differ where not all views reach."""


@dataclass(frozen=True, eq=False)
class Array:
    """Views of a plane, and the disparities to refocus to."""

    views: int
    """Views along each side of the grid."""
    side: int
    """Pixels along each side of a view."""
    disparities: NDArray[np.float64]
    plane: int
    """The index of the disparity that is in focus."""

    def make(self) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Makes the views, and the picture from the middle of the grid `(side, side, 3)`: waves of up to 0.25 cycles a
        pixel.
        """
        random = np.random.default_rng(0)
        angle, frequency = random.uniform(0, 2 * np.pi, (2, 3, 40)) * [[[1]], [[1 / 4]]]  # radians: channels, waves
        phase, down, across = (
            random.uniform(0, 2 * np.pi, (3, 40)),
            frequency * np.sin(angle),
            frequency * np.cos(angle),
        )
        places = self.disparities[self.plane] * (np.arange(self.views) - (self.views - 1) / 2)

        def sample(place_v: float, place_u: float) -> NDArray[np.float64]:
            y, x = np.arange(self.side) + place_v, np.arange(self.side) + place_u
            waves = np.exp(1j * (y[:, None, None] * down + phase)), np.exp(1j * x[:, None, None] * across)
            picture: NDArray[np.float64] = 128 + 6 * np.einsum("yck,xck->yxc", *waves, optimize=True).real
            return picture

        views = np.array([[sample(v, u).round().clip(0, 255).astype(np.uint8) for u in places] for v in places])
        return views, sample(0, 0)


def shift_by_numpy(views: NDArray[np.uint8], disparities: NDArray[np.float64], *, by_rows: bool = False) -> Planes:
    """Computes the same as `refocus`, with the same kernel, as sums of shifted arrays: `(planes, H, W, C)`.

    `by_rows`: the views of a row are added before they are shifted down, which saves half of the work.
    """
    height, width = views.shape[2:4]
    light_field = np.pad(views, [(0, 0), (0, 0), (REACH, REACH), (REACH, REACH), (0, 0)], "edge").astype(np.float32)
    planes = []
    for disparity in disparities:
        (down, reach_y), (across, reach_x) = (
            _list_taps(disparity * (np.arange(count) - (count - 1) / 2), length)
            for count, length in zip(views.shape[:2], (height, width), strict=True)
        )
        total = np.zeros(views.shape[2:], np.float32)
        for row, taps in zip(light_field, down, strict=True):
            moved = np.zeros((row.shape[1], *total.shape[1:]), np.float32)
            for u, view in enumerate(row):
                for tap, target, source in across[u]:
                    moved[:, target] += tap * view[:, source]
                if not by_rows or u == len(row) - 1:
                    for tap, target, source in taps:
                        total[target] += tap * moved[source]
                    moved[:] = 0
        planes.append(total / np.multiply.outer(reach_y, reach_x)[..., np.newaxis])
    return np.array(planes)


def _list_taps(shifts: NDArray[np.float64], length: int) -> tuple[list[list[_Tap]], NDArray[np.float32]]:
    """Lists the weights of each shift that are not 0, and how many shifted views reach each sample, `(length,)`.

    Each weight comes with the samples to write and the samples to read, in views with `REACH` more samples on each
    side.
    """
    found, reach = [], np.zeros(length, np.float32)
    for shift in np.round(shifts, 9):
        whole = int(np.floor(shift))
        start, stop = max(0, int(np.ceil(shift - 0.5))), min(length, int(np.ceil(length - 0.5 + shift)))
        reach[start:stop] += 1
        taps = make_sinc_taps(np.asarray(shift - whole)).astype(np.float32)
        steps = range(2 * REACH - 1 - whole, -1 - whole, -1)
        found.append(
            [
                (tap, slice(start, stop), slice(start + step, stop + step))
                for tap, step in zip(taps, steps, strict=True)
                if tap
            ]
        )
    return found, reach


def refocus_all(views: NDArray[np.uint8], disparities: NDArray[np.float64]) -> Planes:
    """Refocuses with our own method."""
    return np.array(list(refocus(views, disparities)))


CASES = {
    "225 views of 200x200, 32 planes a tenth of a pixel apart": Array(15, 200, np.arange(-15, 17) / 10, 21),
    "49 views of 150x150, 7 planes a seventh of a pixel apart": Array(7, 150, np.arange(7) / 7, 4),
    "225 views of 200x200, 32 planes a pixel apart, -16 to 15": Array(15, 200, np.arange(-16.0, 16), 17),
    "225 views of 200x200, 8 planes a pixel apart, -4 to 3": Array(15, 200, np.arange(-4.0, 4), 5),
}
GROWTH = {
    "views": [Array(count, 200, np.linspace(-1.5, 1.5, 32), 0) for count in (6, 8, 11, 15)],
    "planes": [Array(15, 200, np.linspace(-1.5, 1.5, count), 0) for count in (16, 32, 64, 128)],
    "pixels": [Array(15, side, np.linspace(-1.5, 1.5, 32), 0) for side in (100, 141, 200, 282)],
}


def main(argv: list[str] | None = None) -> int:
    """Prints the methods' times and errors for some arrays, and the power by which the time of ours grows."""
    parser = argparse.ArgumentParser(prog="benchmarks.focus.planes", description=main.__doc__)
    parser.add_argument("--plenopticam", metavar="PYTHON", help="an interpreter that has plenopticam")
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args(argv)
    for index, (title, array) in enumerate(CASES.items()):
        print(f"{title}\n{HEAD}")
        for line in compare(array, args.rounds, args.plenopticam if index else None):
            print(line, flush=True)
        if not index:
            print("plenopticam: left out, it would take an hour: it enlarges each view 15 times for each plane")
        elif not args.plenopticam:
            print("plenopticam: left out; give --plenopticam")
    for name, arrays in GROWTH.items():
        power, seconds = fit_growth(name, arrays, args.rounds)
        print(f"time by {name}: power {power:.2f} ({', '.join(f'{second:.2f}' for second in seconds)} s)", flush=True)
    return 0


def compare(array: Array, rounds: int, python: str | None) -> list[str]:
    """Returns a line for each method, ours first."""
    views, true = array.make()
    border = int(BORDER * array.side)
    inside = slice(border, -border)
    methods: dict[str, Callable[[], Timed]] = {
        "ours": partial(time_call, partial(refocus_all, views, array.disparities)),
        "numpy": partial(time_call, partial(shift_by_numpy, views, array.disparities)),
        "numpy by rows": partial(time_call, partial(shift_by_numpy, views, array.disparities, by_rows=True)),
    }
    with TemporaryDirectory() as folder, ExitStack() as stack:
        if python:
            methods["plenopticam"] = stack.enter_context(
                start_plenopticam(python, Path(folder), views, array.disparities)
            )
        runs = [{name: run() for name, run in methods.items()} for _ in range(rounds + 1)][1:]
    lines = []
    for name in methods:
        times = np.array([run[name][:2] for run in runs])
        ratios = np.median(times / [run["ours"][:2] for run in runs], axis=0)
        error = np.sqrt(np.square(runs[0][name][2][array.plane] - true)[inside, inside].mean())
        numbers = "".join(f"{number:8.2f}" for number in (*np.median(times, axis=0), *ratios, error))
        lines.append(f"{name:14s}{numbers}")
    return lines


def fit_growth(name: str, arrays: list[Array], rounds: int) -> tuple[float, list[float]]:
    """Returns the power of the count of `name` by which processor time grows, and the least times of `rounds`, in
    seconds.
    """
    counts = [{"views": a.views**2, "planes": len(a.disparities), "pixels": a.side**2}[name] for a in arrays]
    jobs = [partial(refocus_all, array.make()[0], array.disparities) for array in arrays]
    seconds = np.min([[time_call(job)[0] for job in jobs] for _ in range(rounds)], axis=0)
    return float(np.polyfit(np.log(counts), np.log(seconds), 1)[0]), seconds.tolist()


def time_call(work: Callable[[], Planes]) -> Timed:
    """Runs `work` in this process and measures its time."""
    cpu, wall = time.process_time(), time.perf_counter()
    planes = work()
    return time.process_time() - cpu, time.perf_counter() - wall, planes


@contextmanager
def start_plenopticam(
    python: str, folder: Path, views: NDArray[np.uint8], disparities: NDArray[np.float64]
) -> Iterator[Callable[[], Timed]]:
    """Starts plenopticam in a process of its own, and yields a function that runs it."""
    source, target = folder / "views.npy", folder / "planes.npy"
    np.save(source, views)
    limits = int(np.floor(disparities[0])), int(np.floor(disparities[-1])) + 1
    worker = Path(__file__).with_name("plenopticam_worker.py")
    command = [python, "-W", "ignore", worker, source, target, *limits, int(disparities[1] % 1 > 0)]
    with subprocess.Popen(list(map(str, command)), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        stdin, stdout = cast("IO[str]", process.stdin), cast("IO[str]", process.stdout)

        def run() -> Timed:
            print(file=stdin, flush=True)
            answer = stdout.readline()
            if not answer:
                raise InvalidOption(f"--plenopticam: {python} ended without an answer; install plenopticam there")
            cpu, wall = map(float, answer.split())
            return cpu, wall, np.load(target)

        yield run


if __name__ == "__main__":
    sys.exit(main())
