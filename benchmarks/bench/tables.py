"""The results as Markdown and CSV."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from ciir.benchmarks.bench.arrays import Route
    from ciir.benchmarks.bench.growth import Line
    from ciir.benchmarks.bench.inference import Row
    from ciir.benchmarks.bench.timing import Alone

Rows = "Sequence[Mapping[str, Any]]"
NOTHING = "not computed"


def write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """One line for each input, lens array, sampling and method."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A Markdown table, an empty line at its end."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def number(value: float | None, digits: int) -> str:
    """`NOTHING` for None, `exact` for infinity (a PSNR without error), a dash for NaN."""
    if value is None:
        return NOTHING
    if math.isnan(value):
        return "-"
    return "exact" if math.isinf(value) else f"{value:.{digits}f}"


def mean(values: Sequence[float | None]) -> float | None:
    """None where a value is missing. Infinite ones, the PSNR of what is exact, are left out unless all are."""
    known = [value for value in values if value is not None]
    finite = [value for value in known if not math.isinf(value)]
    if not known or len(known) < len(values):
        return None
    return sum(finite) / len(finite) if finite else math.inf


MAIN = (
    "method",
    "by",
    "ms (quartiles)",
    "upscale ms",
    "x paper's",
    "GMAC",
    "PSNR",
    "SSIM",
    "gradient",
    "object: PSNR",
    "SSIM",
    "gradient",
)


def main_tables(rows: Sequence[Mapping[str, Any]], kinds: Mapping[str, str]) -> list[str]:
    """A table for each sampling and lens array, means over its inputs."""
    lines: list[str] = []
    order = {method: place for place, method in enumerate(kinds)}
    keys = sorted({(row["sampling"], int(row["lenses"].split("x")[0]), row["lenses"]) for row in rows})
    for sampling, _, lenses in keys:
        here = [row for row in rows if (row["sampling"], row["lenses"]) == (sampling, lenses)]
        inputs = ", ".join(dict.fromkeys(row["input"] for row in here))
        lines += [f"### {lenses} lenses, {sampling} ({inputs})", ""]
        body = []
        for method in sorted({row["method"] for row in here}, key=order.__getitem__):
            some = [row for row in here if row["method"] == method]
            got = {key: mean([row[key] for row in some]) for key in some[0] if key.startswith(NUMBERS)}
            times = f"{number(got['ms_median'], 1)} ({number(got['ms_low'], 1)} to {number(got['ms_high'], 1)})"
            errors = [
                number(got[f"{name}_{where}"], digits)
                if where == "all" or any(row["psnr_object"] is not None for row in here)
                else "-"
                for where in ("all", "object")
                for name, digits in (("psnr", 2), ("ssim", 4))
            ]
            slopes = [
                f"{number(got[f'gradient_{where}'], 2)} / {number(got[f'gradient_worst_{where}'], 1)}"
                if got[f"gradient_{where}"] is not None
                else "-"
                for where in ("all", "object")
            ]
            backends = ", ".join(dict.fromkeys(row["backend"] or "-" for row in some))
            body.append(
                (
                    f"`{method}`", backends, times,
                    number(got["ms_upscale"], 1) if got["ms_upscale"] else "-",
                    number(got["times_faster_than_paper"], 2), number(got["gmacs"], 2) if got["gmacs"] else "-",
                    errors[0], errors[1], slopes[0], errors[2], errors[3], slopes[1],
                )
            )  # fmt: skip
        lines += table(MAIN, body)
        lines += [f"- `{row['method']}` on {row['input']}: {NOTHING}: {row['fault']}" for row in here if row["fault"]]
    return lines


NUMBERS = ("ms_", "times_", "gmacs", "psnr", "ssim", "gradient", "rmse")


def alone_table(found: Mapping[str, Mapping[str, Alone | str]]) -> list[str]:
    """`found`: lens array -> method -> what it took in a process of its own, or why that failed."""
    methods = list(dict.fromkeys(method for of in found.values() for method in of))
    head = ["method", *(f"{lenses}: cold ms / peak MiB" for lenses in found)]

    def cell(got: Alone | str | None) -> str:
        if got is None or isinstance(got, str):
            return f"{NOTHING}: {got}" if got else "-"
        return f"{got.cold_ms:.0f} / {number(got.peak_mib, 0)}"

    return table(head, ([f"`{method}`", *(cell(of.get(method)) for of in found.values())] for method in methods))


def routes_table(routes: Sequence[Route]) -> list[str]:
    """Elemental image arrays."""
    head = ("route", "ms (quartiles)", "times faster than one render for each lens", "pixels that differ from the rays")
    return table(
        head,
        (
            (
                route.name, f"{route.times.median:.0f} ({route.times.low:.0f} to {route.times.high:.0f})",
                "-" if route.times.ratio is None else f"{route.times.ratio:.1f}", f"{100 * route.differ:.3f} %",
            )
            for route in routes
        ),
    )  # fmt: skip


def engines_table(rows: Sequence[Row]) -> list[str]:
    """Inference."""
    sizes = list(dict.fromkeys((row.height, row.width) for row in rows))
    by_engine: dict[str, dict[tuple[int, int], Row]] = {}
    for row in rows:
        by_engine.setdefault(row.engine, {})[row.height, row.width] = row
    head = ["engine", *(f"{w}x{h} ms (x)" for h, w in sizes), "largest difference, levels"]
    return table(
        head,
        (
            [
                engine,
                *(f"{of[size].times.median:.1f} ({number(of[size].times.ratio, 1)})" for size in sizes),
                f"{max(row.differs for row in of.values()):.2f}",
            ]
            for engine, of in by_engine.items()
        ),
    )


def growth_table(lines: Sequence[Line]) -> list[str]:
    """Fitted exponents."""
    return table(
        ("over", "what", "from", "to", "exponent"),
        (
            (
                line.over, line.what, f"{line.counts[0]:,}: {line.milliseconds[0]:.1f} ms",
                f"{line.counts[-1]:,}: {line.milliseconds[-1]:.1f} ms", number(line.exponent, 2),
            )
            for line in lines
        ),
    )  # fmt: skip
