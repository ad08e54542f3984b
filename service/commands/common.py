"""What several commands do alike: find the input, collect the options, write the report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from renderer.bundle import Bundle
from service.atomic import replacing
from service.report import Report, to_json
from service.request import Options

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from service.source import Source

SCENE = "scene:"
_PREFIX = "option_"


def options(args: argparse.Namespace) -> Options:
    """The options that were given on the command line."""
    given = {key.removeprefix(_PREFIX): text for key, text in vars(args).items() if key.startswith(_PREFIX)}
    return Options.parse(given)


def source(text: str) -> Source:
    """`scene:NAME`, or what lies at a path."""
    return text.removeprefix(SCENE) if text.startswith(SCENE) else bundle(text)


def bundle(text: str) -> Bundle:
    """The file, the folder or the zip at a path."""
    return Bundle.from_path(Path(text))


def write_report(report: Report, path: str | None) -> None:
    """Writes the report to `path`, if one was given."""
    if path is not None:
        with replacing(Path(path)) as file:
            file.write(to_json(report))


def bar(unit: str, total: int | None = None) -> tuple[Callable[[int], object], Callable[[], None]]:
    """A progress bar, on a terminal only: what counts it up, and what ends it. `total` is None where nobody knows yet.

    It appears after half a second: short work shows nothing.
    """
    from tqdm import tqdm

    shown = tqdm(total=total, unit=unit, disable=None, delay=0.5, leave=False, file=sys.stderr)
    return shown.update, shown.close


def say(text: str) -> None:
    """A line for whoever asked."""
    print(text, flush=True)


def timings(report: Report) -> str:
    """`decode 3, render 20, total 31 ms`."""
    return ", ".join(f"{stage} {ms:.0f}" for stage, ms in report["timings_ms"].items()) + " ms"
