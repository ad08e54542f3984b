"""Plot of a run: validation PSNR and losses over steps."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


def draw_plot(rows: Sequence[Mapping[str, float]], losses: Sequence[str], title: str) -> bytes:
    """Plots a run as a PNG of 900x700 pixels: PSNR in dB above, the columns `losses` of `rows` below.

    Raises `ModuleNotFoundError` where matplotlib is not installed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 7), dpi=100)
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True)
    mark = "." if len(rows) < 60 else ""  # a line through one point is invisible
    figure.subplots_adjust(left=0.1, right=0.98, top=0.95, bottom=0.07)
    for axes, names, label in ((above, ["psnr"], "PSNR on Y, dB"), (below, losses, "loss, mean since the last row")):
        for name in names:
            points = [(row["step"], row[name]) for row in rows if name in row]
            axes.plot(*zip(*points, strict=True), marker=mark, linewidth=1.2, label=name)
        axes.set_ylabel(label)
        axes.grid(visible=True, alpha=0.3)
    if all(row[name] > 0 for row in rows for name in losses if name in row):  # hinge terms go below zero
        below.set_yscale("log")
    below.legend()
    below.set_xlabel("step")
    above.set_title(title)
    png = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # in a run's name: a box will do
        figure.savefig(png, format="png")
    return png.getvalue()
