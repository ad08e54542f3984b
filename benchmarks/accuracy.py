"""How close each model comes to the view that a lens array with a finer pitch gives, on the shipped scenes.

    python -m ciir.benchmarks.accuracy [--lenses 100] [--scale 2] [--model NAME_OR_CARD ...] [--mesh FILE ...]

The truth is the view rendered at the larger size, area-averaged over its own pixels (`--strategy direct`), whatever
sampled the input. Y-PSNR in dB (BT.601), whole pictures, mean over five views; below, the mean over all scenes and what
that is above bicubic interpolation. No network was trained on these scenes (int8 twins chose their grids on turned
views of them). With `--lenses 25` views are 25x25.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.work import views
from ciir.models import catalogue
from ciir.models.single.interpolation import Bicubic
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scenes import SCENES
from ciir.service.pipeline.options import Options
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma
from ciir.training.evaluation.pictures import load_model

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from ciir.service.pipeline.options import Sampling
    from ciir.service.pipeline.source import Source


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each scene and sampling."""
    parser = argparse.ArgumentParser(prog="benchmarks.accuracy", description=main.__doc__)
    parser.add_argument("--lenses", type=int, default=100, help="lenses along each side (default 100)")
    parser.add_argument("--scale", type=int, default=2, help="times as many in the truth (default 2)")
    parser.add_argument("--mesh", type=Path, nargs="*", default=[], help="mesh files beside the shipped scenes")
    parser.add_argument("--model", nargs="*", help="names that `ciir models` lists, or cards (default: all of scale)")
    given = parser.parse_args(argv)
    sources: dict[str, Source] = {name: name for name in SCENES}
    sources |= {path.stem: Bundle.from_path(path) for path in given.mesh}
    names = given.model or [entry.name for entry in catalogue.list_entries() if given.scale in entry.scales]
    fields = {entry.name for entry in catalogue.list_entries() if entry.is_light_field}
    models = {name: None if name in fields else load_model(name, scale=given.scale) for name in names}
    wide = max(12, *(len(Path(name).stem) + 2 for name in models))
    lenses, pixels = (given.lenses, given.lenses), (15, 15)

    def write(scene: str, sampling: str, words: Sequence[str]) -> None:
        sys.stdout.write(f"{scene:14s}{sampling:10s}" + "".join(f"{word:>{wide}s}" for word in words) + "\n")
        sys.stdout.flush()

    write("scene", "sampling", [Path(name).stem for name in models])
    scores: dict[Sampling, list[NDArray[np.float64]]] = {"pinhole": [], "lenslet": []}
    above = Bicubic(given.scale)
    for name, source in sources.items():
        asked = Options(lenses=lenses, pixels=pixels, views="cross", scale=given.scale, strategy="direct")
        truth = views(source, asked)
        for sampling, rows in scores.items():
            as_seen = replace(asked, strategy="upscale", sampling=sampling, model="none", scale=1)
            low = views(source, as_seen)
            made = [
                upscale_pixels(model, low) if model else views(source, replace(as_seen, model=name, scale=given.scale))
                for name, model in (models | {"": above}).items()
            ]
            rows.append(np.array([score(pictures, truth) for pictures in made]))
            write(name, sampling, [f"{value:.2f}" for value in rows[-1][:-1]])
    for sampling, rows in scores.items():
        mean = np.mean(rows, axis=0)
        write("mean", sampling, [f"{value:.2f}" for value in mean[:-1]])
        write("above bicubic", sampling, [f"{value:+.2f}" for value in mean[:-1] - mean[-1]])
    return 0


def score(made: Iterable[NDArray[np.uint8]], truth: Iterable[NDArray[np.uint8]]) -> float:
    """Mean Y-PSNR in dB."""
    return float(
        np.mean([compute_psnr(rgb_to_luma(a), rgb_to_luma(b), border=0) for a, b in zip(made, truth, strict=True)])
    )


if __name__ == "__main__":
    sys.exit(main())
