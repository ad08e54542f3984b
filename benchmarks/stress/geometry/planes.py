"""Checks depth planes: constant views, linearity in the views, energy, and noise."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.renderer.focus.planes import Method, refocus

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort

GRIDS = ((1, 1), (1, 5), (5, 5), (4, 7))
DISPARITIES = (-3.3, -0.5, 0.0, 0.01, 1.0, 2.75)
"""Disparities in pixels per view."""
BOUND = 1e-6
"""The largest error for views from 0 to 1 in float32."""


def depth_planes(effort: Effort) -> Iterator[Found | Skipped]:
    """Checks depth planes by each method: constant views up to the borders, sums of light fields, and their energy."""
    random = np.random.default_rng(0)
    for method in get_args(Method):
        worst = dict.fromkeys(
            ("of constant views: off by", "of a sum against their sum", "energy, relative"), (0.0, "")
        )
        for grid in GRIDS[-1:] if effort.quick else GRIDS:
            views = random.random((2, *grid, 48, 61, 1), np.float32)
            framed = np.zeros((*grid, 48, 61, 1), np.float32)
            framed[..., 20:28, 25:36, :] = 1 + views[0, ..., 20:28, 25:36, :]  # inside at every disparity
            constant = np.full_like(framed, 0.8)
            for disparity in DISPARITIES:
                planes = [
                    next(refocus(field, [disparity], method=method)) for field in (*views, views[0] + views[1], framed)
                ]
                flat = next(refocus(constant, [disparity], method=method))
                mean = framed.mean(axis=(0, 1), dtype=np.float64).sum()
                measured = (
                    np.abs(flat - 0.8).max(),
                    np.abs(planes[0] + planes[1] - planes[2]).max(),
                    abs(planes[3].sum(dtype=np.float64) / mean - 1),
                )
                where = f"{grid[0]}x{grid[1]} views, disparity {disparity:g}"
                for what, value in zip(worst, measured, strict=True):
                    worst[what] = max(worst[what], (float(value), where))
        for what, (value, where) in worst.items():
            if method == "window" and what.startswith("energy"):
                continue  # windows change it
            yield Found(f"planes, {method}, {what}", BOUND, value, where)


def noise_in_planes(effort: Effort) -> Iterator[Found | Skipped]:
    """Checks depth planes of noise: their deviation times the square root of the number of views, relative to that in a
    view.
    """
    inside = np.s_[20:-20, 20:-20]  # all views reach it
    for views in (5,) if effort.quick else (5, 9, 15):
        noise = np.random.default_rng(0).standard_normal((views, views, 96, 96, 1), np.float32)
        for method in get_args(Method):
            planes = refocus(noise, [0.0, 1.0, 0.1, 0.25, 0.5], method=method)
            left = [views * float(plane[inside].std()) for plane in planes]
            whole = left if method == "delta" else left[:2]
            what = f"planes, {method}, noise in {views}x{views} views"
            yield Found(f"{what}: whole shifts, off by", 0.1, float(np.abs(np.subtract(whole, 1)).max()))
            if method != "delta":
                yield Found(f"{what}: fractions, left", 1.0, max(left[2:]))


CASES: tuple[Case, ...] = (depth_planes, noise_in_planes)
