"""What `benchmarks.peers` found, as two tables in Markdown and as JSON with every single time."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import torch

from ciir.models.sessions import count_available_cores
from ciir.training.loop.run import find_commit

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ciir.models.cards import Accuracy
    from ciir.training.recipe import Recipe

NONE = "-"
TEXT = """\
# Table 2: blocks and batch normalisation

{table_2}

# Table 3: other networks

{table_3}

x{recipe.scale}; PSNR (dB) / SSIM of Y by the published protocol, from the exported networks. `updates`: each of
{recipe.batch} crops of {recipe.crop}x{recipe.crop} pixels, the same for all; {recipe.loss} loss, Adam, step size up to
{recipe.learning_rate:g} after a warm-up of {recipe.warmup} updates, half cosine, seed {recipe.seed}. `s/update`: median
of updates taken in turns; `ratio`: to the paper's generator (lite, 6 blocks), median over the rounds. Multiply-adds:
for an output of 1280x720. `ms/view`: median for 200x200 pixels, onnxruntime (numpy for interpolation) on one core.

Commit {commit}; {processor}, {cores} cores, {training_threads} threads in training, GPU: {gpu}.
"""


@dataclass(frozen=True)
class Figures:
    """A row. What a network hasn't is None."""

    name: str
    label: str
    accuracy: tuple[Accuracy, ...] = ()
    """Empty where it was not trained."""
    updates: int | None = None
    """0 where it was not trained."""
    parameters: int | None = None
    """Those that are trained, of the collapsed network."""
    multiply_adds: float | None = None
    """For an output of 1280x720, 10^9."""
    milliseconds: float | None = None
    """A view of 200x200 pixels on one CPU core, median."""
    seconds_per_update: float | None = None
    """Median."""
    ratio: float | None = None
    """Median, over the rounds, of its update's time to that of the paper's generator in the same round."""


COLUMNS: dict[str, Callable[[Figures], str]] = {
    "network": lambda row: row.label,
    "updates": lambda row: _number(row.updates, "d") if row.updates != 0 else "not trained",
    **{
        name: lambda row, index=index: _score(row, index)  # type: ignore[misc]
        for index, name in enumerate(("Set5", "Set14", "BSD100"))
    },
    "s/update": lambda row: _number(row.seconds_per_update, ".3f"),
    "ratio": lambda row: _number(row.ratio, ".2f"),
    "parameters": lambda row: _number(row.parameters, ",d"),
    "G multiply-adds": lambda row: _number(row.multiply_adds, ".1f"),
    "ms/view": lambda row: _number(row.milliseconds, ".1f"),
}


def write(
    out: Path,
    rows: Mapping[str, Figures],
    times: Mapping[str, Any],
    recipe: Recipe,
    *,
    table_2: Sequence[str],
    table_3: Sequence[str],
) -> str:
    """Writes `tables.md` and `figures.json` into `out`, and returns the former. `recipe`: of any of the networks."""
    machine = {
        "processor": f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}",
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "cores": count_available_cores(),
        "cores_of_the_machine": os.cpu_count(),
        "training_threads": torch.get_num_threads(),
        "view_threads": 1,
        "torch": torch.__version__,
    }
    same = {key: value for key, value in asdict(recipe).items() if key not in ("name", "network", "options")}
    found = {
        "commit": find_commit(),
        "machine": machine,
        "recipe": same,
        "networks": {name: asdict(row) for name, row in rows.items()},
        "times": times,
    }
    text = TEXT.format(
        table_2="\n".join(table([rows[name] for name in table_2 if name in rows])),
        table_3="\n".join(table([rows[name] for name in table_3 if name in rows])),
        recipe=recipe,
        commit=found["commit"],
        gpu=machine["gpu"] or "none",
        **{key: machine[key] for key in ("processor", "cores", "training_threads")},
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / "tables.md").write_text(text, encoding="utf-8")
    (out / "figures.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return text


def table(rows: Sequence[Figures]) -> list[str]:
    """Lines of Markdown."""
    head = [" | ".join(COLUMNS), " | ".join(["---", *["---:"] * (len(COLUMNS) - 1)])]
    return [f"| {line} |" for line in (*head, *(" | ".join(cell(row) for cell in COLUMNS.values()) for row in rows))]


def _number(value: float | None, form: str) -> str:
    return NONE if value is None else format(value, form)


def _score(row: Figures, index: int) -> str:
    if not row.accuracy:
        return NONE
    return f"{row.accuracy[index].psnr:.2f} / {row.accuracy[index].ssim:.4f}"
