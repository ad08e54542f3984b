"""`ciir reconstruct`."""

from __future__ import annotations

import os
import shutil
import zipfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from service import pipeline
from service.atomic import replacing
from service.commands import common, out
from service.outputs import FORMATS, FileSink, FolderSink

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from service.answers import Answer
    from service.report import Report
    from service.request import Options
    from service.source import Source
    from service.store import Store


def run(args: argparse.Namespace) -> None:
    """Writes the views and the report, and says what was written."""
    is_file = out.is_file(args.out, [f".{name}" for name in FORMATS], what="views")
    path = Path(args.out)
    out.check_not_input([path, *common.report_path(args.report)], args.input)
    common.check_report(args.report, path)
    options, source, store = common.options(args), common.source(args.input), _store()
    if store is not None:
        report = _stored(source, options, store, path, None if is_file else Path(args.input))
    elif is_file:
        report = _to_file(source, options, path)
    else:
        report = _to_folder(source, options, path, Path(args.input))
    common.finish(report, args.report)
    views = report["views"]
    size = f"{views[0]['width']}x{views[0]['height']}"
    common.say(f"{args.out}: {len(views)} view{'s' * (len(views) > 1)} of {size} pixels ({common.timings(report)})")


def _store() -> Store | None:
    """Where results are stored: nowhere, unless `CIIR_STORE` names a folder."""
    if not os.environ.get("CIIR_STORE"):
        return None
    from service import settings

    return settings.read().open_store()


def _to_file(source: Source, options: Options, path: Path) -> Report:
    with replacing(path) as file, FileSink(file, _format(path)) as sink, common.bar("view") as count:
        return pipeline.reconstruct(source, options, sink, progress=count)


def _to_folder(source: Source, options: Options, path: Path, given: Path) -> Report:
    with FolderSink(path, given) as sink, common.bar("view") as count:
        return pipeline.reconstruct(source, options, sink, progress=count)


def _stored(source: Source, options: Options, store: Store, path: Path, given: Path | None) -> Report:
    """Into the file `path`, or where the input `given` is named the folder, by way of the store."""
    if given is None:
        with replacing(path) as file, _answer(source, options, store, _format(path)) as made:
            shutil.copyfileobj(made.file, file)
            return made.report
    with FolderSink(path, given) as sink, _answer(source, options, store, "zip") as made:
        _unpack(made.report, zipfile.ZipFile(made.file), sink)
        return made.report


@contextmanager
def _answer(source: Source, options: Options, store: Store, form: str) -> Iterator[Answer]:
    """Stored or made, in a file that is closed in the end; what troubled the store is noted in the report."""
    from service.answers import answer

    with common.bar("view") as count:
        made = answer(source, options, form, store=store, progress=count)
    with made.file:
        if made.trouble:
            made.report["notes"].append(made.trouble)
        yield made


def _unpack(report: Report, archive: zipfile.ZipFile, sink: FolderSink) -> None:
    """The views of a zip into a folder; encoding them again makes the same bytes."""
    from renderer.pictures import decode

    sink.begin(len(report["views"]))
    for view in report["views"]:
        sink.add((view["v"], view["u"]), decode(archive.read(view["file"]), name=view["file"]))
    sink.finish(report)


def _format(path: Path) -> str:
    return path.suffix.lower().removeprefix(".")
