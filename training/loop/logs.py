"""Logs of a run: log.csv, a TensorBoard file and a plot."""

from __future__ import annotations

import csv
import io
import sys
from typing import TYPE_CHECKING

from ciir.errors import advise_extra
from ciir.renderer.writers.atomic_write import replacing
from ciir.training.loop import plot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from torch import Tensor
    from torch.utils.tensorboard import SummaryWriter

    Row = dict[str, float]

OTHER = ("step", "learning_rate", "psnr", "seconds", "seconds_per_step")
"""Columns other than losses."""


class Means:
    """Mean losses over steps, accumulated on their device: only `take` waits for a GPU."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor | float] = {}
        self._steps = 0

    def add(self, terms: Mapping[str, Tensor | float]) -> None:
        """Adds one step's losses: numbers, or tensors of one element without a gradient."""
        for name, value in terms.items():
            self._sums[name] = self._sums.get(name, 0.0) + value
        self._steps += 1

    def take(self) -> dict[str, float]:
        """Returns the means since the last `take`."""
        means = {name: float(value) / self._steps for name, value in self._sums.items()}
        self._sums, self._steps = {}, 0
        return means


class Log:
    """The log of a run in the folder `out` that continues from `step`: later rows of an interrupted run are dropped.

    `log.csv` has a row for each validation: `step`; `loss`, the sum of the terms, and each term, means over the steps
    since the row before; `learning_rate`; `psnr` in dB; `seconds` of the whole run; `seconds_per_step` without the
    validations. `tensorboard/` has the same values and `plot.png` plots them. Where the package tensorboard or
    matplotlib is not installed, its file is missing and a note goes to standard error.

    Raises `ValueError` where `out/log.csv` is not a log, and `OSError` where the disk is full.
    """

    def __init__(self, out: Path, *, title: str, step: int) -> None:
        self.out, self.title = out, title
        path = out / "log.csv"
        self.rows = [row for row in read_log(path) if row["step"] <= step] if path.exists() else []
        self._draw = True
        self._events = _open_events(out / "tensorboard", step)

    def add(self, row: Row) -> None:
        """Adds a row: `OTHER` and the losses."""
        self.rows.append(row)
        with replacing(self.out / "log.csv") as file:
            file.write(_to_csv(self.rows))
        if self._draw:
            try:
                picture = plot.draw_plot(self.rows, list_losses(self.rows), self.title)
                with replacing(self.out / "plot.png") as file:
                    file.write(picture)
            except ModuleNotFoundError as error:
                self._draw = False
                _note_missing(error, "plot.png")
        if self._events is not None:
            for name, value in row.items():
                if name != "step":
                    tag = name if name in OTHER else f"losses/{name}"
                    self._events.add_scalar(tag, value, int(row["step"]))
            self._events.flush()


def read_log(path: Path) -> list[Row]:
    """Reads the rows of a `log.csv`. Raises `ValueError` where the file is not one."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [{name: float(text) for name, text in row.items() if text} for row in csv.DictReader(file)]
        return [row | {"step": int(row["step"]), "psnr": row["psnr"]} for row in rows]
    except (ValueError, KeyError, TypeError, AttributeError, csv.Error) as error:
        raise ValueError(f"{path}: not the log of a run; move it away, or name another folder") from error


def list_losses(rows: Sequence[Row]) -> list[str]:
    """Lists the columns of `rows` that are losses, in order of appearance."""
    return [name for name in dict.fromkeys(name for row in rows for name in row) if name not in OTHER]


def _to_csv(rows: Sequence[Row]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, ["step", *list_losses(rows), *OTHER[1:]], lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.7g}" for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def _open_events(folder: Path, step: int) -> SummaryWriter | None:
    """Opens a new event file; TensorBoard joins it to older ones in `folder`, and hides their events after `step`."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ModuleNotFoundError as error:
        _note_missing(error, "tensorboard")
        return None
    return SummaryWriter(folder, purge_step=step + 1)


def _note_missing(error: ModuleNotFoundError, file: str) -> None:
    print(f"note: no {file}: the package {error.name} is not installed ({advise_extra('training')})", file=sys.stderr)
