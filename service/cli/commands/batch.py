"""`ciir batch`: reconstructs many inputs, on all cores of this machine or on a cluster."""

from __future__ import annotations

import re
import sys
import time
import uuid
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ciir.cores import count_available_cores
from ciir.errors import InvalidOption
from ciir.renderer.writers.formats import BY_SUFFIX
from ciir.service.cli import common, output_path
from ciir.service.cli.messages import format_message
from ciir.service.errors import join_lines
from ciir.service.pipeline.source import SCENE

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator

    from ciir.service.batch.run import Report
    from ciir.service.batch.summary import Summary
    from ciir.service.batch.task import Outcome, Task

SOME_FAILED = 3
"""Exit status if some inputs failed."""
LINE_SECONDS = 30.0
"""Interval between progress lines, which are printed if there is no bar."""
_UNITS = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "KIB": 2**10, "MIB": 2**20, "GIB": 2**30}


def run(args: argparse.Namespace) -> None:
    """Writes the outputs and the summary, and prints a line about them. Exits with `SOME_FAILED` if some failed."""
    options = common.parse_options(args)
    is_file = output_path.names_file(args.name, list(BY_SUFFIX), what="views")
    workers = None if args.workers is None else common.read_count("--workers", args.workers, 1, 1024, example=4)
    memory = _read_size(args.worker_memory)
    if args.cluster and (args.workers or args.worker_memory):
        raise InvalidOption("--workers, --worker-memory: these are for workers on this machine; leave them out")
    from ciir.service.batch import inputs
    from ciir.service.batch.places import Outputs
    from ciir.service.batch.record import Record
    from ciir.service.batch.run import Batch
    from ciir.service.batch.summary import Summary
    from ciir.service.batch.task import Request
    from ciir.service.pipeline.source import make_layout, read_frame

    has_arrays = options.lenses is not None or options.pixels is not None or options.known_grid is not None
    found, textures = inputs.find_inputs(args.inputs, has_arrays=has_arrays, sets=args.sets)
    common.print_notes(inputs.describe_textures(textures))
    all_frames = make_layout(options).selects_frame and not hasattr(args, "option_frame")
    tasks = inputs.make_tasks(found, args.name, is_file=is_file, all_frames=all_frames)
    place = _resolve_outputs(args.out, args.inputs, [each.source for each in (*found, *textures)])
    given = {name: path for name in ("white", "dark") if (path := getattr(args, name)) is not None}
    if not args.cluster:  # there they are files of the workers' machines
        for name, path in given.items():
            read_frame(name, path)  # otherwise each input would fail for the same reason
    frames = {name: str(Path(path).resolve()) for name, path in given.items()}
    request = Request(options, place, uuid.uuid4().hex, **frames)
    outputs, summary, batch = Outputs(place), Summary(tasks), Batch(request)

    def finish() -> None:
        for task in batch.stopped:
            record = Record(outputs, task, request)
            if task.part is None and record.is_of(request.run):  # it was finished after the command was interrupted
                summary.add(task, record.outcome)
        summary.write(outputs)

    with outputs.lock(), _finishing(args.out, summary, finish), batch, _showing(len(tasks)) as show:
        if args.cluster:
            batch.connect(args.cluster)
        else:
            batch.start_local(workers or count_available_cores(), memory)

        def report(task: Task, outcome: Outcome | None, added: int) -> None:
            if outcome is not None:
                summary.add(task, outcome)
            show(task, outcome, added)

        batch.run(tasks, report)
    common.print_line(_describe(args.out, summary))
    if summary.count()["failed"]:
        raise SystemExit(SOME_FAILED)


def _describe(out: str, summary: Summary) -> str:
    """Says in one line how many inputs are done."""
    counts, found = summary.count(), summary.describe()
    parts = [f"{counts['done']} of {found['inputs']} inputs done"]
    parts += [f"{counts['kept']} done before"] if counts["kept"] else []
    parts += [f"{counts['failed']} failed: summary.csv says why"] if counts["failed"] else []
    rate = f", {counts['done'] / found['seconds']:.2g} a second" if counts["done"] else ""
    return f"{out}: {', '.join(parts)} ({found['seconds']:.0f} s{rate})"


@contextmanager
def _finishing(out: str, summary: Summary, finish: Callable[[], None]) -> Iterator[None]:
    """Calls `finish` at the end of the block. If the block is interrupted, prints how far it came and how to go on."""
    try:
        yield
    except BaseException as error:
        finish()
        if not isinstance(error, Exception):  # Ctrl-C or SIGTERM
            line = f"ciir: {_describe(out, summary)}; the same command continues"
            print(line, file=sys.stderr, flush=True)
        raise
    finish()


@contextmanager
def _showing(total: int) -> Iterator[Report]:
    """Shows progress with throughput and time left: a bar on a terminal, otherwise a line now and then.

    Errors are shown at once.
    """
    shown = time.monotonic()
    with common.open_bar(total=total, unit="task", smoothing=0.05) as bar:
        begun, done = shown, 0

        def show(task: Task, outcome: Outcome | None, added: int) -> None:
            nonlocal done, shown, total
            done, total = done + 1, total + added
            if outcome is not None and outcome.status == "failed":
                what = _name_once(task.source, format_message(outcome.error, [task.source]))
                bar.write(f"ciir: {join_lines(what)}", file=sys.stderr)
            bar.total = total
            bar.update()
            now = time.monotonic()
            if bar.disable and now > shown + LINE_SECONDS:
                shown, rate = now, done / (now - begun)
                line = f"ciir: {done} of {total} done, {rate:.2g} a second, {(total - done) / rate:.0f} s left"
                print(line, file=sys.stderr, flush=True)

        yield show


def _name_once(source: str, error: str) -> str:
    """Returns the error with the whole name of the input before it, which an error may begin with, or its last part."""
    if error.startswith(source):
        return error
    return f"{source}: {error.removeprefix(f'{PurePosixPath(source).name}: ')}"


def _resolve_outputs(text: str, inputs: list[str], sources: list[str]) -> str:
    """Returns the folder for the outputs.

    Raises `InvalidOption` if an input lies in it, also through links, or if it lies in an input. `inputs`: as given;
    `sources`: what was found in them.
    """
    from ciir.service.batch.places import locate, resolve

    place, where = text.rstrip("/"), locate(text) if "://" in text else text
    if "://" not in where:
        place = where = str(output_path.resolve_folder(where, what="the outputs").resolve())
    if where.startswith("memory:"):
        raise InvalidOption(
            f"{text}: files in memory are lost when the command ends; give a folder, or a URL such as s3://"
        )
    folder = PurePosixPath(where)
    given = [(each, path) for each in inputs if not each.startswith(SCENE) for path in resolve(locate(each))]
    found = [(each, path) for each in sources if not each.startswith(SCENE) for path in resolve(each)]
    for source, path in (*given, *found):
        if folder.is_relative_to(path):
            raise InvalidOption(
                f"{text}: this lies in the input {source} and would be read as a part of it; give another folder"
            )
    for source, path in found:
        if path.is_relative_to(folder):
            raise InvalidOption(f"{text}: the input {source} is there; give another folder, so that nothing is lost")
    return place


def _read_size(text: str | None) -> int | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([A-Z]*)", text.strip().upper())
    if found is None or found[2] not in _UNITS or float(found[1]) * _UNITS[found[2]] < 2**28:
        raise InvalidOption(f"--worker-memory: {text[:40]!r} is not a size of 256MiB or more; give one such as 2GiB")
    return int(float(found[1]) * _UNITS[found[2]])
