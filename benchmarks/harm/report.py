"""Formats the harm table as JSON and Markdown, worst case first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ciir.benchmarks.bench.tables import format_table
from ciir.benchmarks.harm.case import PICTURE
from ciir.benchmarks.harm.score import BICUBIC, BOUND, DEFAULT

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ciir.benchmarks.harm.score import Row

EXPLANATION = f"""\
PSNR in dB and SSIM of Y against the truth. `against bicubic`: `default` - `bicubic`. `against single`: `default` - the
best single-picture network, if the default took a light-field network. A case is over the bound if one of them is
below -{BOUND} dB.
"""


def describe_row(row: Row) -> dict[str, Any]:
    """Returns a row for JSON, without pictures."""
    return {
        "case": row.label,
        "input": row.input,
        "kind": row.kind,
        "factors": dict(row.factors),
        "model": row.model,
        "against_bicubic": row.against_bicubic,
        "against_single": row.against_single,
        "best_single": row.best_single,
        "is_over": row.is_over,
        "psnr": dict(row.psnr),
        "ssim": dict(row.ssim),
        "notes": list(row.notes),
    }


def format_line(row: Row) -> str:
    """Formats a row as one line of text."""
    line = f"{row.against_bicubic:+6.2f} dB against bicubic"
    if row.against_single is not None:
        line += f", {row.against_single:+6.2f} against {row.best_single}"
    return f"{line}: {row.label} ({row.model})"


def format_tables(rows: Sequence[Row]) -> list[str]:
    """Returns counts by input and by factor, then every row; `rows` are sorted."""
    by_input = {name: [row for row in rows if row.input == name] for name in dict.fromkeys(row.input for row in rows)}
    lines = [EXPLANATION, "## By input", "", *_format_groups(by_input)]
    for kind in dict.fromkeys(row.kind for row in rows):
        some = [row for row in rows if row.kind == kind]
        if kind == PICTURE:
            conditions = dict.fromkeys(", ".join(row.conditions) for row in some)
            by_condition = {text: [row for row in some if ", ".join(row.conditions) == text] for text in conditions}
            lines += [f"## By conditions: {kind}", "", *_format_groups(by_condition)]
        by_factor = {
            f"{name} {value}": [row for row in some if row.factors[name] == value]
            for name in some[0].factors
            for value in sorted({row.factors[name] for row in some}, key=lambda text: (len(text), text))
        }
        lines += [f"## By factor: {kind}", "", *_format_groups(by_factor)]
        lines += [f"## Every case: {kind}", "", *_format_rows(some)]
    return lines


def _format_groups(groups: Mapping[str, Sequence[Row]]) -> list[str]:
    cells = []
    for name, some in groups.items():
        singles = [row.against_single for row in some if row.against_single is not None]
        cells.append(
            [
                name,
                str(len(some)),
                str(sum(row.is_over for row in some)),
                _format_worst([row.against_bicubic for row in some]),
                _format_worst(singles),
            ]
        )
    head = ("", "cases", "over the bound", "against bicubic: worst, mean", "against single: worst, mean")
    return format_table(head, cells)


def _format_worst(margins: Sequence[float]) -> str:
    return f"{min(margins):+.2f}, {sum(margins) / len(margins):+.2f}" if margins else "-"


def _format_rows(rows: Sequence[Row]) -> list[str]:
    names = dict.fromkeys(name for row in rows for name in row.psnr if name not in (BICUBIC, DEFAULT))
    head = ("", "model", "against bicubic", "against single", "SSIM: bicubic", "default", "PSNR: bicubic", "default")
    cells = []
    for row in rows:
        single = "-" if row.against_single is None else f"{row.against_single:+.2f} ({row.best_single})"
        margin = f"{row.against_bicubic:+.2f}"
        psnr = [f"{row.psnr[name]:.2f}" if name in row.psnr else "-" for name in (BICUBIC, DEFAULT, *names)]
        ssim = [f"{row.ssim[name]:.4f}" for name in (BICUBIC, DEFAULT)]
        label = f"**{row.label}**" if row.is_over else row.label
        cells.append([label, row.model, margin, single, *ssim, *psnr])
    return format_table((*head, *names), cells)
