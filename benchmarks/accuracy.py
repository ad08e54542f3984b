"""Measures how close each model comes to the view of a lens array with a finer pitch, on the shipped scenes.

    python -m ciir.benchmarks.accuracy [--lenses 100] [--scale 2] [--model NAME_OR_CARD ...] [--mesh FILE ...]

The truth is the view rendered at the larger size, area-averaged over its own pixels (`--strategy direct`), whatever
sampled the input. Y-PSNR in dB (BT.601), whole pictures, mean over five views; below, the mean over all scenes and how
far that is above bicubic interpolation. No network was trained on these scenes (int8 networks chose their grids on
turned views of them).
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.work import SAMPLINGS, reconstruct_views
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
    parser.add_argument("--scale", type=int, default=2, help="upscaling factor (default 2)")
    parser.add_argument("--mesh", type=Path, nargs="*", default=[], help="mesh files beside the shipped scenes")
    parser.add_argument(
        "--model", nargs="*", help="names that `ciir models` lists, or cards (default: all of the scale)"
    )
    args = parser.parse_args(argv)
    sources: dict[str, Source] = {name: name for name in SCENES}
    sources |= {path.stem: Bundle.from_path(path) for path in args.mesh}
    names = args.model or [entry.name for entry in catalogue.list_entries() if args.scale in entry.scales]
    light_field = {entry.name for entry in catalogue.list_entries() if entry.is_light_field}
    models = {name: None if name in light_field else load_model(name, scale=args.scale) for name in names}
    models[""] = Bicubic(args.scale)
    _print_row("scene", "sampling", [Path(name).stem for name in names])
    scores: dict[Sampling, list[list[float]]] = {sampling: [] for sampling in SAMPLINGS}
    for scene, source in sources.items():
        direct = Options(
            lenses=(args.lenses, args.lenses), pixels=(15, 15), views="cross", scale=args.scale, strategy="direct"
        )
        truth = reconstruct_views(source, direct)[0]
        for sampling in SAMPLINGS:
            mapped = replace(direct, strategy="upscale", sampling=sampling, model="none", scale=1)
            low = reconstruct_views(source, mapped)[0]
            row = []
            for name, model in models.items():
                whole = replace(mapped, model=name, scale=args.scale)
                views = upscale_pixels(model, low) if model else reconstruct_views(source, whole)[0]
                row.append(average_psnr(views, truth))
            scores[sampling].append(row)
            _print_row(scene, sampling, [f"{value:.2f}" for value in row[:-1]])
    for sampling, rows in scores.items():
        *means, bicubic = np.mean(rows, axis=0)
        _print_row("mean", sampling, [f"{value:.2f}" for value in means])
        _print_row("above bicubic", sampling, [f"{value - bicubic:+.2f}" for value in means])
    return 0


def average_psnr(views: Iterable[NDArray[np.uint8]], truth: Iterable[NDArray[np.uint8]]) -> float:
    """Mean Y-PSNR in dB."""
    pairs = zip(views, truth, strict=True)
    return float(np.mean([compute_psnr(rgb_to_luma(one), rgb_to_luma(other), border=0) for one, other in pairs]))


def _print_row(scene: str, sampling: str, cells: Sequence[str]) -> None:
    print(f"{scene:14s}{sampling:10s}" + "".join(f"{cell:>14s}" for cell in cells), flush=True)


if __name__ == "__main__":
    sys.exit(main())
