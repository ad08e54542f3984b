"""Depth planes: of constant views, linear in the views, and of their energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.renderer.focus.planes import BORDER, Method, refocus

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort

GRIDS = ((1, 1), (1, 5), (5, 5), (4, 7))
DISPARITIES = (-3.3, -0.5, 0.0, 0.01, 1.0, 2.75)
"""Pixels a view."""
BOUND = 1e-6
"""Of views from 0 to 1: float32. With windows it grows by what a pixel in a corner counts less."""


def depth_planes(effort: Effort) -> Iterator[Found | Skipped]:
    """Depth planes by each method: of constant views, to the borders, of sums of light fields, and their energy."""
    random = np.random.default_rng(0)
    for method in get_args(Method):
        worst = dict.fromkeys(
            ("of constant views: off by", "of a sum against their sum", "energy, relative"), (0.0, "")
        )
        for grid in GRIDS[-1:] if effort.quick else GRIDS:
            views = random.random((2, *grid, 48, 61, 1), np.float32)
            framed = np.zeros((*grid, 48, 61, 1), np.float32)
            framed[..., 20:28, 25:36, :] = 1 + views[0, ..., 20:28, 25:36, :]  # inside at every disparity
            for disparity in DISPARITIES:
                planes = [
                    next(refocus(field, [disparity], method=method))
                    for field in (np.full_like(framed, 0.8), *views, views[0] + views[1], framed)
                ]
                mean = framed.mean(axis=(0, 1), dtype=np.float64).sum()
                measured = (
                    np.abs(planes[0] - 0.8).max(),
                    np.abs(planes[1] + planes[2] - planes[3]).max(),
                    abs(planes[4].sum(dtype=np.float64) / mean - 1),
                )
                where = f"{grid[0]}x{grid[1]} views, disparity {disparity:g}"
                for what, value in zip(worst, measured, strict=True):
                    worst[what] = max(worst[what], (float(value), where))
        for what, (value, where) in worst.items():
            if method == "window" and what.startswith("energy"):
                continue  # windows change it
            bound = BOUND / BORDER**2 if method == "window" else BOUND
            yield Found(f"planes, {method}, {what}", bound, value, where)


CASES: tuple[Case, ...] = (depth_planes,)
