"""Draws the harm table's figure: all margins, and crops of the worst cases."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from ciir.benchmarks.harm.score import BOUND, DEFAULT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from ciir.benchmarks.harm.score import Row

CROPS = 10
"""How many cases are shown with crops."""
PER_INPUT = 2
"""The most of them for one input, so that they differ."""
MARGINS = (0.1, 0.1, 0.3, 0.84)
"""Left, bottom, width and height of the plot of margins, as shares of the figure's sides."""
LEFT, TOP = 0.53, 0.96
"""Left and top of the crops, as shares of the figure's sides."""
TICKS = (-10, -5, -2, -1, -0.5, 0, 0.5, 1, 2, 5, 10)


def plot_harm(rows: Sequence[Row], path: Path, *, title: str) -> None:
    """Writes the figure of `rows`, which are sorted with the worst first, to `path`."""
    from matplotlib.figure import Figure

    worst = _select_worst(rows)
    figure = Figure(figsize=(20, 2.5 * max(5, len(worst)) + 1))
    figure.suptitle(title)
    _plot_margins(figure.add_axes(MARGINS), rows)
    height, width = TOP / len(worst), (1 - LEFT) / 4
    for number, row in enumerate(worst):
        bottom = TOP - (number + 1) * height
        figure.text(LEFT - 0.005, bottom + height / 2, _describe(row), fontsize=9, ha="right", va="center")
        for column, (name, crop) in enumerate(row.crops.items()):
            panel = figure.add_axes((LEFT + column * width, bottom + 0.04 * height, 0.97 * width, 0.82 * height))
            panel.set_axis_off()
            panel.imshow(crop, interpolation="nearest")
            model = f" ({row.model})" if name == DEFAULT else ""
            score = f"\n{row.psnr[name]:.2f} dB" if name in row.psnr else "\n"
            panel.set_title(f"{name}{model}{score}", fontsize=9)
    figure.savefig(path, dpi=80)


def _select_worst(rows: Sequence[Row]) -> list[Row]:
    """Returns the worst rows, at most `PER_INPUT` of each input."""
    counts: Counter[str] = Counter()
    chosen: list[Row] = []
    for row in rows:
        counts[row.input] += 1
        if counts[row.input] <= PER_INPUT and len(chosen) < CROPS:
            chosen.append(row)
    return chosen


def _plot_margins(panel: Axes, rows: Sequence[Row]) -> None:
    """Draws a strip for each input, with a point for each margin."""
    names = list(dict.fromkeys(row.input for row in rows))[::-1]
    series = {
        "default - bicubic": [(row.against_bicubic, row.input) for row in rows],
        "light-field default - best single-picture network": [
            (row.against_single, row.input) for row in rows if row.against_single is not None
        ],
    }
    for number, (label, points) in enumerate(series.items()):
        seen: Counter[str] = Counter()
        places = []
        for _, name in points:
            seen[name] += 1
            places.append(names.index(name) + 0.2 * (1 - 2 * number) + 0.015 * (seen[name] % 11 - 5))
        panel.plot([margin for margin, _ in points], places, "o^"[number], markersize=4, alpha=0.6, label=label)
    panel.axvline(-BOUND, color="red", linewidth=1, label=f"the bound, -{BOUND} dB")
    panel.set_xscale("symlog", linthresh=1.0)
    panel.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    panel.set_yticks(range(len(names)), names)
    panel.set_ylim(-0.5, len(names) - 0.5)
    panel.set_xlabel("dB of Y-PSNR; linear from -1 to 1, then logarithmic")
    panel.grid(visible=True, axis="x", alpha=0.3)
    panel.legend(loc="upper left", bbox_to_anchor=(0, -0.04))


def _describe(row: Row) -> str:
    """Returns the row's label in short lines, and its margins."""
    lines = [row.input, *row.conditions, f"{row.against_bicubic:+.2f} dB against bicubic"]
    return "\n".join(lines if row.against_single is None else [*lines, f"{row.against_single:+.2f} against single"])
