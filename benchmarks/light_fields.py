"""Measures what a light-field network gains over single pictures, and whether it does harm or changes the parallax.

    python -m ciir.benchmarks.light_fields ../shared/data/lightfields/knights [--model field field-int8]

Accuracy: Y-PSNR in dB of the middle view and the corners of the middle 5x5 and 9x9 of a folder of views, downsampled in
three ways. Harm: windows of another scene, views moved by more than the network was trained for, noise. Parallax: the
disparity between upscaled neighbours against the truth's.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.parallax import estimate_disparities
from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.single.pixels import upscale_pixels
from ciir.training.data import downscale
from ciir.training.data.light_field.views import degrade_views, read_views
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    Views = NDArray[np.uint8]
    """`(V, U, H, W, 3)`."""
    Truths = Mapping[tuple[int, int], NDArray[np.uint8]]
    """(v, u) -> the true view."""
    Row = tuple[str, Views, Truths]
    """Label, downsampled light field and truths."""

SINGLES = ("bicubic", "fast", "quality")
GRIDS = (5, 9)
SHIFTS = (1, 3, 8)
"""Whole LR pixels by which each view is moved on the one before: the network looks for 2 at most."""
SIGMAS = (10, 40)
"""Standard deviations of noise, 8-bit levels."""


def upscale_view(model: str, low: Views, at: tuple[int, int]) -> NDArray[np.uint8]:
    """View `at` of a light field by `model`; a light-field network uses the others too."""
    if model in catalogue.list_single_image_names():
        single: NDArray[np.uint8] = upscale_pixels(catalogue.load_upscaler(model), low[at][np.newaxis])[0]
        return single
    grid = (low.shape[0], low.shape[1])
    every = {(v, u): low[v, u] for v in range(grid[0]) for u in range(grid[1])}
    network = catalogue.load_light_field_network(model)
    fallback = catalogue.load_upscaler(catalogue.find_fallback(network.card))
    views, _ = upscale_views(network, fallback, every, [at], grid)
    return np.asarray(views[0], np.uint8)


def average_psnr(model: str, low: Views, truths: Truths) -> float:
    """Mean Y-PSNR in dB over `truths`; a border of 2 is cut."""
    upscaled = {at: rgb_to_luma(upscale_view(model, low, at)) for at in truths}
    return float(np.mean([compute_psnr(upscaled[at], rgb_to_luma(truth), border=2) for at, truth in truths.items()]))


def list_captured(folder: Path) -> Iterator[Row]:
    """A captured light field, downsampled: the middle of the grid, and its corners."""
    for count in GRIDS:
        views = read_views(folder, grid=(count, count))
        middle, last = (count // 2, count // 2), count - 1
        for kind in downscale.KINDS:
            low, high = degrade_views(views, kind, 2)
            corners = {at: high[at] for at in ((0, 0), (0, last), (last, last))}
            yield f"{folder.name} {count}x{count} {kind}, inner", low, {middle: high[middle]}
            yield f"{folder.name} {count}x{count} {kind}, corners", low, corners


def list_harmful(folder: Path) -> Iterator[Row]:
    """Inputs that must not mislead a network; the truth is the middle view."""
    views = read_views(folder, grid=(5, 5))
    random = np.random.default_rng(0)
    for kind in ("bicubic", "point"):
        low, high = degrade_views(views, kind, 2)
        truth = {(2, 2): high[2, 2]}
        other = np.ascontiguousarray(low[:, :, ::-1, ::-1])
        mixed = other.copy()
        mixed[2, 2] = low[2, 2]
        yield f"{kind}, another scene around the middle view", mixed, truth
        halves = low.copy()
        halves[:, 3:] = other[:, 3:]
        yield f"{kind}, another scene on the right", halves, truth
        for shift in SHIFTS:
            yield f"{kind}, each view moved by {shift}", shift_views(low, shift), truth
        for sigma in SIGMAS:
            noisy = np.clip(low + random.normal(0, sigma, low.shape), 0, 255).round().astype(np.uint8)
            yield f"{kind}, noise of {sigma} levels", noisy, truth
    low, high = degrade_views(random.integers(0, 256, views.shape).astype(np.uint8), "bicubic", 2)
    yield "nothing but noise", low, {(2, 2): high[2, 2]}


def shift_views(low: Views, shift: int) -> Views:
    """Each view rolled by `shift` pixels for each step from the middle."""
    result = low.copy()
    for v, u in np.ndindex(low.shape[:2]):
        by = ((v - low.shape[0] // 2) * shift, (u - low.shape[1] // 2) * shift)
        result[v, u] = np.roll(low[v, u], by, (0, 1))
    return result


def print_psnr(rows: Iterable[Row], models: Sequence[str]) -> None:
    """A line for each light field: every model's score, and the first model's gain over single pictures."""
    print(f"{'Y-PSNR':44s}" + "".join(f"{model:>11s}" for model in models) + f"{'- quality':>11s}{'- fast':>9s}")
    for name, low, truths in rows:
        psnr = {model: average_psnr(model, low, truths) for model in models}
        gains = [psnr[models[0]] - psnr[model] for model in ("quality", "fast")]
        cells = "".join(f"{psnr[model]:11.2f}" for model in models)
        print(f"{name:44s}{cells}{gains[0]:+11.2f}{gains[1]:+9.2f}", flush=True)


def print_parallax(folder: Path, models: Sequence[str]) -> None:
    """Median and 90 % quantile of the disparity's error over textured patches, right and down of the middle."""
    views = read_views(folder, grid=(7, 7))
    for kind in downscale.KINDS:
        low, high = degrade_views(views, kind, 2)
        for model in models:
            errors: list[NDArray[np.float64]] = []
            for axis, other in ((0, (4, 3)), (1, (3, 4))):
                first, second = (rgb_to_luma(upscale_view(model, low, at)) for at in ((3, 3), other))
                true_first, true_second = (rgb_to_luma(high[at]) for at in ((3, 3), other))
                truth = estimate_disparities(true_first, true_second, axis)
                errors.append(np.abs(estimate_disparities(first, second, axis) - truth).ravel())
            found = np.concatenate(errors)
            found = found[np.isfinite(found)]
            middle, most = np.median(found), np.quantile(found, 0.9)
            print(f"{folder.name} {kind:8s} {model:12s} median {middle:.3f}, 90 % {most:.3f}, {len(found)} patches")


def main(argv: list[str] | None = None) -> int:
    """Prints all tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.light_fields", description=main.__doc__)
    parser.add_argument("folder", type=Path, help="views of a light field, 9x9 or more")
    parser.add_argument("--model", nargs="+", default=["field"], help="light-field networks")
    args = parser.parse_args(argv)
    models = (*args.model, *SINGLES)
    print_psnr(list_captured(args.folder), models)
    print_psnr(list_harmful(args.folder), models)
    print("\nDisparity between upscaled neighbours against the truth's, pixels of the truth")
    print_parallax(args.folder, models)
    return 0


if __name__ == "__main__":
    sys.exit(main())
