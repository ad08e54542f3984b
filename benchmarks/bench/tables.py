"""Formats the results as Markdown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ciir.benchmarks.bench.results import NUMBERS, group_rows

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

NOTHING = "not computed"
COLUMNS = {
    "method": "`{method}`",
    "backend": "{backend}",
    "ms (quartiles)": "{ms_median:.1f} ({ms_low:.1f} to {ms_high:.1f})",
    "upscale ms": "{ms_upscale:.1f}",
    "times faster than paper": "{times_faster_than_paper:.2f}",
    "GMAC": "{gmacs:.2f}",
    "PSNR": "{psnr_all:.2f}",
    "SSIM": "{ssim_all:.4f}",
    "object: PSNR": "{psnr_object:.2f}",
    "object: SSIM": "{ssim_object:.4f}",
}
"""Heading -> format of its cell; `-` if a number is missing."""


def format_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Formats a Markdown table, followed by an empty line."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def average(values: Sequence[float | None]) -> float | None:
    """Returns the mean; None if a value is missing. Infinite values, PSNRs of exact pictures, count only if all are
    infinite.
    """
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    finite = [value for value in known if not math.isinf(value)]
    return sum(finite) / len(finite) if finite else math.inf


def format_results(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Formats a table for each sampling and lens array, with means over its inputs, then the methods that failed."""
    lines: list[str] = []
    for (sampling, lenses), methods in group_rows(map(dict, rows)).items():
        every = [row for some in methods.values() for row in some]
        inputs = ", ".join(dict.fromkeys(row["input"] for row in every))
        lines += [f"### {lenses} lenses, {sampling} ({inputs})", ""]
        lines += format_table(tuple(COLUMNS), [_format_row(some) for some in methods.values()])
        lines += [f"- `{r['method']}` on {r['input']}: {NOTHING}: {r['error']}" for r in every if r["error"]]
    return lines


def _format_row(some: Sequence[Mapping[str, Any]]) -> list[str]:
    backend = ", ".join(dict.fromkeys(row["backend"] or "-" for row in some))
    numbers = {name: average([row[name] for row in some]) for name in ("gmacs", *NUMBERS)}
    known = {name: value for name, value in numbers.items() if value is not None and not math.isnan(value)}
    cells = []
    for form in COLUMNS.values():
        try:
            cells.append(form.format(method=some[0]["method"], backend=backend, **known).replace("inf", "exact"))
        except KeyError:
            cells.append(NOTHING if "ms_median" in form else "-")
    return cells
