"""Helpers that several commands share: options, reports, progress and output."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.options import TEXT_FILES, read_description
from ciir.renderer.writers.writer import report_json
from ciir.service.cli.messages import format_message
from ciir.service.pipeline.options import KINDS
from ciir.service.pipeline.source import add_frames, draw_grid_at, open_source

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable, Iterator, Sequence

    from tqdm import tqdm

    from ciir.service.pipeline.options import KindName, Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source
    from ciir.service.settings import Settings

_PREFIX = "option_"
BAR_DELAY = 0.5
"""Seconds after which a progress bar appears, so that short work shows none."""
BAR_INTERVAL = 1.0
"""Seconds after which the time on a progress bar is updated while nothing is finished."""
BAR_WIDTH = 79
"""Columns of a progress bar on a terminal that states no size, as under `script` in a pipe: tqdm would show nothing."""


def parse_options(args: argparse.Namespace, kind: KindName = "reconstruction") -> Options:
    """Parses the options on the command line, with the defaults of that kind of job. Raises `InvalidOption`."""
    given = {key.removeprefix(_PREFIX): text for key, text in vars(args).items() if key.startswith(_PREFIX)}
    return KINDS[kind].parse(
        given | {name: read_description(name, Path(given[name])) for name in TEXT_FILES if name in given}
    )


def read_count(option: str, text: str, least: int, most: int, *, example: int) -> int:
    """Parses the whole number given for `option`. Raises `InvalidOption`, which names the range and `example`."""
    if not text.isdecimal() or not least <= int(text) <= most:
        raise InvalidOption(
            f"{option}: {text[:40]!r} is not a whole number from {least} to {most}; give one such as {example}"
        )
    return int(text)


def open_input(args: argparse.Namespace, options: Options) -> Source:
    """Opens the input with the white and dark frames given on the command line.

    With `--show-grid`, the source writes its lens grid when it is read. Raises `InputError`.
    """
    source = add_frames(open_source(args.input), white=args.white, dark=args.dark)
    if args.show_grid is not None:
        source = draw_grid_at(source, options, args.show_grid)
    return source


def start_service() -> Settings:
    """Prepares this process for a server or a worker, while it has only one thread, and returns the settings.

    Raises `InvalidOption`.
    """
    from ciir.service import logs, memory, settings
    from ciir.service.jobs.workers.sandbox.parent import protect
    from ciir.service.jobs.workers.worker import KEPT_VARIABLES

    found = settings.read_settings()
    logs.configure(found.log_format)
    settings.warn_of_unknown()
    protect(KEPT_VARIABLES)
    memory.limit_heaps(memory.HEAPS)
    return found


def write_report(report: Report, path: str | None) -> None:
    """Writes the report to `path`, if one was given, and prints its notes."""
    if path is not None:
        with replacing(Path(path)) as file:
            file.write(report_json(report))
    print_notes(report["notes"])


def print_notes(notes: Iterable[str]) -> None:
    """Prints a line on standard error for each note."""
    for note in notes:
        print(f"ciir: note: {format_message(note)}", file=sys.stderr)


def find_folders(
    names: Sequence[str], *, what: str = "*_LR.png and *_HR.png pairs, or of views for a light-field network"
) -> list[Path]:
    """Returns the folders called `names`, which hold `what`. Raises `InvalidOption` if one isn't there."""
    folders = [Path(name) for name in names]
    for folder in folders:
        if not folder.is_dir():
            raise InvalidOption(f"{folder}: no such folder; give one of {what}")
    return folders


@contextmanager
def progress_bar(unit: str) -> Iterator[Progress]:
    """Shows a progress bar with the time left, on a terminal only. Yields `progress(done, total)`, which moves it."""
    if sys.stderr is None or not sys.stderr.isatty():  # tqdm would find that too, but takes 10 ms to be imported
        yield ignore_progress
        return
    with open_bar(unit=unit) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield progress


@contextmanager
def open_bar(**settings: Any) -> Iterator[tqdm[Any]]:
    """Opens a bar of tqdm on standard error, which is disabled if that is no terminal.

    It appears after `BAR_DELAY`, also before anything is finished, so that reading a large input looks alive.
    """
    from tqdm import tqdm

    with tqdm(**settings, delay=BAR_DELAY, leave=False, file=sys.stderr, disable=None) as bar:
        if bar.disable:
            yield bar
            return
        if bar.ncols is not None and bar.ncols < 1:
            bar.ncols, bar.nrows = BAR_WIDTH, None
        ended = Event()

        def refresh() -> None:
            wait = BAR_DELAY
            while not ended.wait(wait):
                bar.delay, wait = 0, BAR_INTERVAL  # shown from now on, so that closing the bar clears it
                bar.refresh()

        thread = Thread(target=refresh, name="progress", daemon=True)
        thread.start()
        try:
            yield bar
        finally:
            ended.set()
            thread.join()


def print_line(text: str) -> None:
    """Prints a line and flushes it."""
    print(text, flush=True)


def format_timings(report: Report) -> str:
    """Formats the timings of a report: `decode 3, render 20, total 31 ms`."""
    return ", ".join(f"{stage} {ms:.0f}" for stage, ms in report["timings_ms"].items()) + " ms"
