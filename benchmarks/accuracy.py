"""How close each model comes to the view that a lens array with half the pitch gives, on the shipped scenes.

    python -m benchmarks.accuracy [--lenses 100] [--mesh FILE ...]

The truth is the view rendered at the larger size, area-averaged over its own pixels (`--strategy direct`), whatever
sampled the input. Y-PSNR in dB (BT.601), whole pictures, mean over five views. No shipped network saw these scenes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models import catalogue
from models.metrics import luma, psnr
from renderer.bundle import Bundle
from renderer.scenes import SCENES
from service.pipeline import reconstruct
from service.request import Options

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from renderer.pictures import Pixels
    from service.report import Report
    from service.source import Source


class Kept:
    """A sink that keeps the views."""

    def __init__(self) -> None:
        self.views: list[NDArray[np.uint8]] = []

    def begin(self, count: int) -> None:
        """Any number is fine."""

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Keeps a view."""
        self.views.append(pixels.astype(np.uint8))  # a rendered view has 8 bits
        return f"{view}"

    def finish(self, report: Report) -> None:
        """Nothing is left to do."""


def views(source: Source, options: Options) -> list[NDArray[np.uint8]]:
    """The views that `options` ask for."""
    sink = Kept()
    reconstruct(source, options, sink)
    return sink.views


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each scene and sampling."""
    parser = argparse.ArgumentParser(prog="benchmarks.accuracy", description=main.__doc__)
    parser.add_argument("--lenses", type=int, default=100, help="lenses along each side (default 100)")
    parser.add_argument("--mesh", type=Path, nargs="*", default=[], help="mesh files beside the shipped scenes")
    given = parser.parse_args(argv)
    sources: dict[str, Source] = {name: name for name in SCENES}
    sources |= {path.stem: Bundle.from_path(path) for path in given.mesh}
    models = [entry.name for entry in catalogue.entries()]
    lenses, pixels = (given.lenses, given.lenses), (15, 15)
    sys.stdout.write(f"{'scene':14s}{'sampling':10s}" + "".join(f"{model:>12s}" for model in models) + "\n")
    for name, source in sources.items():
        truth = views(source, Options(lenses=lenses, pixels=pixels, views="cross", strategy="direct"))
        for sampling in ("pinhole", "lenslet"):
            row = f"{name:14s}{sampling:10s}"
            for model in models:
                made = views(
                    source, Options(lenses=lenses, pixels=pixels, views="cross", sampling=sampling, model=model)
                )
                scores = [psnr(luma(a), luma(b), border=0) for a, b in zip(made, truth, strict=True)]
                row += f"{np.mean(scores):12.2f}"
            sys.stdout.write(row + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
