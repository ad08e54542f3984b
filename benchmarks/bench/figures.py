"""Draws the benchmark's figures: time against error with its frontier, and crops side by side."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ciir.benchmarks.bench.errors import find_worst_window
from ciir.benchmarks.bench.methods import DIRECT
from ciir.benchmarks.bench.results import find_frontier

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from ciir.benchmarks.bench.results import Point, Result

SIDE = 40
"""Pixels along each side of a crop."""


def plot_pareto(points: Sequence[Point], path: Path, *, title: str) -> None:
    """Plots time against error with the frontier, a panel for each lens array and sampling."""
    from matplotlib.figure import Figure

    panels = list(dict.fromkeys((point.sampling, point.lenses) for point in points))
    down = math.ceil(len(panels) / 2)
    figure = Figure(figsize=(16, 5 * down + 1), layout="constrained")
    axes = figure.subplots(down, 2, squeeze=False).T.ravel()
    for panel in axes[len(panels) :]:
        panel.set_axis_off()
    for panel, (sampling, lenses) in zip(axes, panels, strict=False):
        panel.set_title(f"{lenses} lenses, {sampling}")
        _plot_panel(panel, [point for point in points if (point.sampling, point.lenses) == (sampling, lenses)])
    figure.suptitle(title)
    figure.savefig(path, dpi=80)


def _plot_panel(panel: Axes, points: Sequence[Point]) -> None:
    """Draws a panel. Direct rendering, whose error is a hundred times smaller, is a dotted line at its time."""
    for number, point in enumerate(points):
        label, colour = f"{point.method}: {point.milliseconds:.1f} ms, {point.rmse:.2f}", f"C{number % 10}"
        if point.kind == DIRECT:
            panel.axvline(point.milliseconds, linestyle=":", color=colour, label=label)
        else:
            panel.loglog(point.milliseconds, point.rmse, "os^DPX*v"[number % 8], color=colour, label=label)
    best = find_frontier(points)
    panel.step([p.milliseconds for p in best], [p.rmse for p in best], where="post", color="black", linewidth=1)
    panel.set_xlabel("milliseconds for one view, from bytes to PNG")
    panel.set_ylabel("error: RMS of Y, 8-bit levels")
    panel.grid(visible=True, which="both", alpha=0.3)
    panel.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=9)


def plot_crops(results: Sequence[Result], path: Path, *, methods: Sequence[str]) -> None:
    """Draws a crop of each centre view by each of `methods`, where nearest-neighbour's error is largest."""
    from matplotlib.figure import Figure

    shown = [result for result in results if min(result.work.truth.shape[1:3]) >= SIDE]
    if not shown:
        return
    columns = [name for name in methods if any(name in result.pictures for result in shown)]
    figure = Figure(figsize=(2 * len(columns) + 4, 2.4 * len(shown)), layout="constrained")
    axes = figure.subplots(len(shown), len(columns) + 2, squeeze=False)
    for panel in axes.ravel():
        panel.set_axis_off()
    for panels, result in zip(axes, shown, strict=True):
        middle = len(result.work.truth) // 2
        truth = result.work.truth[middle]
        window = find_worst_window(result.pictures["nearest"][middle], truth, truth, side=SIDE)
        y, x = (side.start for side in window)
        panels[0].imshow(truth)
        panels[0].plot([x, x + SIDE, x + SIDE, x, x], [y, y, y + SIDE, y + SIDE, y], color="red")
        panels[0].set_title(f"{result.work.name}, {result.work.sampling}", fontsize=9)
        panels[1].imshow(truth[window])
        panels[1].set_title("truth", fontsize=9)
        psnr = {row["method"]: row["psnr_all"] for row in result.rows}
        for panel, name in zip(panels[2:], columns, strict=True):
            if name in result.pictures:
                panel.imshow(result.pictures[name][middle][window])
                panel.set_title(f"{name}, {psnr[name]:.2f} dB", fontsize=9)
    figure.savefig(path, dpi=80)
