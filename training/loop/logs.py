"""Logs of a run: log.csv, a TensorBoard file, a plot, and the progress on standard error."""

from __future__ import annotations

import csv
import io
import sys
import warnings
from typing import TYPE_CHECKING

from tqdm import tqdm

from ciir.errors import advise_extra
from ciir.renderer.writers.atomic_write import replacing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from torch import Tensor
    from torch.utils.tensorboard import SummaryWriter

    Row = dict[str, float]

OTHER = ("step", "learning_rate", "psnr", "seconds", "seconds_per_step")
"""Columns other than losses."""


class Means:
    """Mean losses over steps. They are accumulated on their device, so that only `take` waits for a GPU."""

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
    """The log of a run in the folder `out` that continues from `step`. Later rows of an interrupted run are dropped.

    `log.csv` has a row for each validation: `step`; `loss`, the sum of the terms, and each term, as means over the
    steps since the previous row; `learning_rate`; `psnr` in dB; `seconds` of the whole run; `seconds_per_step` without
    the validations. `tensorboard/` has the same values and `plot.png` plots them. If the package tensorboard or
    matplotlib is not installed, its file is missing and a note is printed on standard error.

    Raises `ValueError` if `out/log.csv` is not a log, and `OSError` if the disk is full.
    """

    def __init__(self, out: Path, *, title: str, step: int) -> None:
        self.out, self.title = out, title
        path = out / "log.csv"
        self.rows = [row for row in read_log(path) if row["step"] <= step] if path.exists() else []
        self._draw = True
        self._events = _open_events(out / "tensorboard", step)

    def add(self, row: Row) -> None:
        """Adds a row with `OTHER` and the losses."""
        self.rows.append(row)
        with replacing(self.out / "log.csv") as file:
            file.write(_to_csv(self.rows))
        if self._draw:
            try:
                picture = draw_plot(self.rows, list_losses(self.rows), self.title)
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
    """Reads the rows of a `log.csv`. Raises `ValueError` if the file is not one."""
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
    """Opens a new event file. TensorBoard joins it to older ones in `folder` and hides their events after `step`."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ModuleNotFoundError as error:
        _note_missing(error, "tensorboard")
        return None
    return SummaryWriter(folder, purge_step=step + 1)


def _note_missing(error: ModuleNotFoundError, file: str) -> None:
    print(f"note: no {file}: the package {error.name} is not installed ({advise_extra('training')})", file=sys.stderr)


def draw_plot(rows: Sequence[Mapping[str, float]], losses: Sequence[str], title: str) -> bytes:
    """Plots a run as a PNG of 900x700 pixels, with PSNR in dB above and the columns `losses` of `rows` below.

    Raises `ModuleNotFoundError` if matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 7), dpi=100)
    above, below = figure.subplots(2, 1, sharex=True)
    mark = "." if len(rows) < 60 else ""  # a line through one point is invisible
    figure.subplots_adjust(left=0.1, right=0.98, top=0.95, bottom=0.07)
    for axes, names, label in ((above, ["psnr"], "PSNR on Y, dB"), (below, losses, "loss, mean since the last row")):
        for name in names:
            points = [(row["step"], row[name]) for row in rows if name in row]
            axes.plot(*zip(*points, strict=True), marker=mark, linewidth=1.2, label=name)
        axes.set_ylabel(label)
        axes.grid(visible=True, alpha=0.3)
    if all(row[name] > 0 for row in rows for name in losses if name in row):  # hinge terms can be below zero
        below.set_yscale("log")
    below.legend()
    below.set_xlabel("step")
    above.set_title(title)
    png = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # in a run's name; a box is good enough
        figure.savefig(png, format="png")
    return png.getvalue()


class Progress(tqdm):  # type: ignore[misc]
    """Progress on standard error from `step` of `steps`: time left, last loss, last validation PSNR in dB.

    `minutes`: the time after which the run ends, of which `seconds` have passed already; 0 if no time is set. On a
    terminal there is a bar, which only counts steps if a time ends the run. Elsewhere there is a line for each
    validation.
    """

    def __init__(self, step: int, steps: int, psnr: float, minutes: float = 0.0, seconds: float = 0.0) -> None:
        self.psnr, self.steps, self.minutes, self.before = psnr, steps, minutes, seconds
        total = None if minutes else steps  # otherwise a bar would show the time left for all steps
        super().__init__(initial=step, total=total, unit="step", disable=None, file=sys.stderr, dynamic_ncols=True)

    def count_step(self, loss: float | None) -> None:
        """Counts a step. `loss`: its loss if known."""
        if loss is not None:
            left = ""
            if self.minutes:
                seconds = max(0.0, 60 * self.minutes - self.before - self.format_dict["elapsed"])
                left = f", {self.format_interval(seconds)} left"
            self.set_postfix_str(f"loss {loss:.4g}, PSNR {self.psnr:.2f} dB{left}", refresh=False)
        self.update()

    def report_validation(self, step: int, *, loss: float, psnr: float, pace: float, seconds: float) -> None:
        """Reports a validation after `step`, with the mean loss since the previous one. `pace`: seconds per step.
        `seconds`: time since the run began.
        """
        self.psnr = psnr
        if self.disable:
            left = (self.steps - step) * pace
            if self.minutes:
                left = max(0.0, min(left, 60 * self.minutes - seconds))
            text = f"loss {loss:.4g}, PSNR {psnr:.2f} dB, {pace:.3g} s a step, {self.format_interval(left)} left"
            print(f"step {step} of {self.steps}: {text}", file=sys.stderr, flush=True)
