"""`ciir reconstruct`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from service import pipeline
from service.atomic import replacing
from service.commands import common
from service.outputs import FORMATS, FileSink, FolderSink

if TYPE_CHECKING:
    import argparse

    from service.report import Report
    from service.request import Options
    from service.source import Source


def run(args: argparse.Namespace) -> None:
    """Writes the views and the report, and says what was written."""
    options, source = common.options(args), common.source(args.input)
    report = _reconstruct(source, options, Path(args.out))
    common.write_report(report, args.report)
    views = report["views"]
    size = f"{views[0]['width']}x{views[0]['height']}"
    common.say(f"{args.out}: {len(views)} view{'s' * (len(views) > 1)} of {size} pixels ({common.timings(report)})")


def _reconstruct(source: Source, options: Options, out: Path) -> Report:
    count, close = common.bar("view")
    try:
        suffix = out.suffix.lower().removeprefix(".")
        if suffix in FORMATS and not out.is_dir():
            with replacing(out) as file:
                return pipeline.reconstruct(source, options, FileSink(file, suffix), progress=count)
        with FolderSink(out) as sink:
            return pipeline.reconstruct(source, options, sink, progress=count)
    finally:
        close()
