"""The tables of `benchmarks.peers`: a row for each network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.benchmarks.bench.tables import format_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.models.cards import Accuracy

SETS = ("Set5", "Set14", "BSD100")

TEXT = """\
# Table 2: blocks and batch normalisation

{table_2}

# Table 3: other networks

{table_3}

x{recipe.scale}; PSNR (dB) / SSIM of Y by the published protocol, from the exported networks. `updates`: each of
{recipe.batch} crops of {recipe.crop}x{recipe.crop} pixels, the same for all; {recipe.loss} loss, Adam, step size up to
{recipe.learning_rate:g} after a warm-up of {recipe.warmup} updates, half cosine, seed {recipe.seed}. `s/update`:
median; `ratio`: to the paper's generator (lite, 6 blocks), median over the rounds. Multiply-adds: for an output of
1280x720. `ms/view`: median for 200x200 pixels, onnxruntime (numpy for interpolation) on one core.

Commit {commit}; {processor}, {cores} cores, {threads} threads in training, GPU: {gpu}.
"""


@dataclass(frozen=True)
class Figures:
    """A row; a figure is None if the network doesn't have it."""

    label: str
    accuracy: tuple[Accuracy, ...] = ()
    """Empty if the network was not trained."""
    updates: int | None = None
    """0 if the network was not trained."""
    parameters: int | None = None
    """Parameters of the collapsed network."""
    multiply_adds: float | None = None
    """Multiply-adds for an output of 1280x720, in 10^9."""
    milliseconds: float | None = None
    """Median time for a view of 200x200 pixels on one CPU core."""
    seconds_per_update: float | None = None
    """The median."""
    ratio: float | None = None
    """Median over the rounds of its update's time relative to that of the paper's generator in the same round."""


def format_rows(rows: Sequence[Figures]) -> str:
    """Formats the rows as a Markdown table."""

    def format_number(value: float | None, form: str) -> str:
        return "-" if value is None else format(value, form)

    head = ("network", "updates", *SETS, "s/update", "ratio", "parameters", "G multiply-adds", "ms/view")
    cells = [
        [
            row.label,
            "not trained" if row.updates == 0 else format_number(row.updates, "d"),
            *([f"{score.psnr:.2f} / {score.ssim:.4f}" for score in row.accuracy] or "---"),
            format_number(row.seconds_per_update, ".3f"),
            format_number(row.ratio, ".2f"),
            format_number(row.parameters, ",d"),
            format_number(row.multiply_adds, ".1f"),
            format_number(row.milliseconds, ".1f"),
        ]
        for row in rows
    ]
    return "\n".join(format_table(head, cells))
