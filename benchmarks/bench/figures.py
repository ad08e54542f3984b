"""The benchmark's pictures: time against error with its frontier, growth, and crops side by side."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

    from ciir.benchmarks.bench.growth import Line
    from ciir.benchmarks.bench.results import Point, Result

INK, FAINT, FRONTIER = "#222222", "#8a8a8a", "#b0006e"
LOOKS = {
    "interpolation": ("#6b6b6b", "o"),
    "float network": ("#0b63b5", "s"),
    "int8 network": ("#d55e00", "^"),
    "nothing skipped": ("#b8860b", "X"),
    "light-field network": ("#7a3aa8", "P"),
    "direct rendering": ("#1b8a5a", "D"),
}
"""Kind of method -> colour and marker; told apart without colours too."""
DIRECT = "direct rendering"
"""Its errors are a hundred times smaller: it is drawn on the lower edge, and its label gives the number."""
COLOURS = ("#0b63b5", "#d55e00", "#1b8a5a", "#b0006e", "#6b6b6b", "#a07800")


def pareto(points: Sequence[Point], path: Path, *, title: str) -> None:
    """Time against error, a panel for each sampling (across) and its counts of lenses (down), the frontier drawn.

    `points`: means over scenes. The line joins the methods that
    need no mesh and that no other beats in both.
    """
    from matplotlib.figure import Figure

    across = sorted({point.sampling for point in points}, reverse=True)
    counts = {sampling: sorted({p.lenses for p in points if p.sampling == sampling}) for sampling in across}
    down = range(max(len(some) for some in counts.values()))
    figure = Figure(figsize=(8.2 * len(across), 5.0 * len(down) + 0.9), layout="constrained", facecolor="white")
    panels = figure.subplots(len(down), len(across), squeeze=False)
    for row in down:
        for column, sampling in enumerate(across):
            panel = panels[row][column]
            if row >= len(counts[sampling]):
                panel.set_axis_off()
                continue
            lenses = counts[sampling][row]
            panel.set_title(f"{lenses} lenses, {sampling}", fontsize=12, color=INK)
            _panel(panel, [point for point in points if point.sampling == sampling and point.lenses == lenses])
    figure.suptitle(title, fontsize=13, color=INK)
    figure.savefig(path, dpi=80)


def _panel(panel: Axes, points: Sequence[Point]) -> None:
    upscaled = [point for point in points if point.kind != DIRECT]
    low, high = min(point.rmse for point in upscaled), max(point.rmse for point in upscaled)
    left, right = min(p.milliseconds for p in points), max(p.milliseconds for p in points)
    edge = low * (low / high) ** 0.12
    heights = {point.method: point.rmse if point.kind != DIRECT else edge for point in points}
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlim(left / 1.15, right * (right / left) ** 0.6 * 1.6)
    panel.set_ylim(edge * (low / high) ** 0.05, high * (high / low) ** 0.1)
    best = frontier(points)
    panel.step(
        [p.milliseconds for p in best] + [right], [p.rmse for p in best] + [best[-1].rmse],
        where="post", color=FRONTIER, linewidth=1.4, zorder=1,
    )  # fmt: skip
    for point in points:
        colour, marker = LOOKS[point.kind]
        panel.plot(
            point.milliseconds, heights[point.method], marker, color=colour, markersize=8, markeredgecolor="white",
            zorder=3,
        )  # fmt: skip
    _label(panel, points, heights, best, right * (right / left) ** 0.12)
    panel.set_xlabel("milliseconds for one view, from bytes to PNG", color=INK)
    panel.set_ylabel("error: RMS of Y, 8-bit levels", color=INK)
    panel.grid(visible=True, which="both", color="#e8e8e8", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)
    for axis in (panel.xaxis, panel.yaxis):
        _round_ticks(axis)


def _round_ticks(axis: Axis) -> None:
    """1, 2, 5, 10, 20, ...: a logarithmic axis that can be read over less than a decade too."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def _label(
    panel: Axes, points: Sequence[Point], heights: dict[str, float], best: Sequence[Point], column: float
) -> None:
    """Every point's name, time and error, in one column on the right at even steps, with a line to its point."""
    order = sorted(points, key=lambda point: (heights[point.method], point.rmse))
    low, high = (math.log(edge) for edge in panel.get_ylim())
    for number, point in enumerate(order):
        place = math.exp(low + (high - low) * (number + 0.6) / (len(order) + 0.2))
        on_it = point in best
        error = f"{point.rmse:.2f}" if point.rmse > 0 else "0 (the truth)"
        away = ", below the axis" if point.kind == DIRECT else ""
        panel.annotate(
            f"{point.method}  {point.milliseconds:.1f} ms, {error}{away}",
            xy=(point.milliseconds, heights[point.method]), xytext=(column, place),
            fontsize=9, fontweight="bold" if on_it else "normal", color=FRONTIER if on_it else INK, va="center",
            arrowprops={"arrowstyle": "-", "color": "#c9c9c9", "linewidth": 0.7, "shrinkB": 4},
        )  # fmt: skip


def frontier(points: Sequence[Point]) -> list[Point]:
    """Of the methods that work from a lens array's views, those than which none is both as quick and as close, in the
    order of time. Direct rendering needs the mesh, and with it there is nothing to upscale."""
    best: list[Point] = []
    for point in sorted(points, key=lambda point: (point.milliseconds, point.rmse)):
        if point.kind != DIRECT and (not best or point.rmse < best[-1].rmse):
            best.append(point)
    return best


def growth(lines: Sequence[Line], path: Path, *, title: str) -> None:
    """A panel for each quantity, both axes logarithmic; the legend gives the fitted exponents."""
    from matplotlib.figure import Figure

    groups = [(over, list(some)) for over, some in groupby(lines, key=lambda line: line.over)]
    figure = Figure(figsize=(15, 9), layout="constrained", facecolor="white")
    panels = figure.subplots(2, 3).ravel()
    for panel, (over, some) in zip(panels, groups, strict=False):
        for number, line in enumerate(some):
            colour = COLOURS[number % len(COLOURS)]
            label = f"{line.what}: ~ n^{line.exponent:.2f}"
            panel.loglog(line.counts, line.milliseconds, "o-", color=colour, linewidth=1.5, markersize=5, label=label)
        panel.set_xlabel(over, color=INK)
        panel.set_ylabel("milliseconds", color=INK)
        panel.set_xticks(some[0].counts, [f"{count:,}" for count in some[0].counts], rotation=30, fontsize=8)
        panel.minorticks_off()
        _round_ticks(panel.yaxis)
        panel.grid(visible=True, color="#e8e8e8", linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
        panel.legend(fontsize=8, frameon=False)
    for panel in panels[len(groups) :]:
        panel.set_axis_off()
    figure.suptitle(title, fontsize=13, color=INK)
    figure.savefig(path, dpi=80)


SIDE, ZOOM, MARGIN, HEAD, LABEL = 40, 4, 12, 40, 44
"""Pixels: a crop's side, how large each is shown, the space around, above, and below for two lines of text."""


def crops(results: Sequence[Result], path: Path, *, lenses: int, methods: Sequence[str]) -> None:
    """A crop of the centre view of every scene at `lenses`, by each of `methods`, beside the truth: the place where
    nearest-neighbour's error is largest."""
    chosen = [r for r in results if r.work.lenses[0] == lenses or r.work.kind == "light field"]
    chosen = [result for result in chosen if min(result.work.truth.shape[1:3]) >= SIDE]
    if not chosen:
        return
    columns = [name for name in methods if any(name in result.pictures for result in chosen)]
    cell = SIDE * ZOOM + MARGIN
    across, down = MARGIN + (len(columns) + 2) * cell, HEAD + len(chosen) * (SIDE * ZOOM + LABEL)
    sheet = Image.new("RGB", (across, down), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for number, head in enumerate(["the view", "truth", *columns]):
        pen.text((MARGIN + number * cell, MARGIN), head, INK, font)
    for row, result in enumerate(chosen):
        top = HEAD + row * (SIDE * ZOOM + LABEL)
        middle = len(result.work.truth) // 2
        truth = result.work.truth[middle]
        y, x = _worst_place(result.pictures["nearest"][middle], truth)
        whole = Image.fromarray(truth)
        box = ImageDraw.Draw(whole)
        box.rectangle((x - 1, y - 1, x + SIDE, y + SIDE), outline=(255, 60, 60), width=max(1, len(truth) // 100))
        whole.thumbnail((SIDE * ZOOM, SIDE * ZOOM))
        sheet.paste(whole, (MARGIN, top))
        pen.text((MARGIN, top + SIDE * ZOOM + 2), f"{result.work.name}\n{result.work.sampling}", FAINT, font)
        for number, name in enumerate([None, *columns], start=1):
            if name is not None and name not in result.pictures:
                continue
            picture = truth if name is None else result.pictures[name][middle]
            crop = picture[y : y + SIDE, x : x + SIDE].repeat(ZOOM, 0).repeat(ZOOM, 1)
            sheet.paste(Image.fromarray(crop), (MARGIN + number * cell, top))
            if name is not None:
                error = result.errors[name]
                words = f"{error.psnr:.2f} dB\nSSIM {error.ssim:.4f}"
                pen.text((MARGIN + number * cell, top + SIDE * ZOOM + 2), words, FAINT, font)
    sheet.save(path, optimize=True)


def _worst_place(picture: np.ndarray, truth: np.ndarray) -> tuple[int, int]:
    """Row and column of the `SIDE x SIDE` window in which `picture` is furthest from `truth`."""
    error = ((picture.astype(float) - truth) ** 2).sum(axis=-1)
    total = np.pad(error, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    sums = total[SIDE:, SIDE:] - total[:-SIDE, SIDE:] - total[SIDE:, :-SIDE] + total[:-SIDE, :-SIDE]
    row, column = np.unravel_index(int(sums.argmax()), sums.shape)
    return int(row), int(column)
