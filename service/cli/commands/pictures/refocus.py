"""`ciir refocus`: makes depth planes, or a picture that is in focus everywhere, from any input."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.stacks import PLANE, PLANE_BY_SUFFIX, STACK, STACK_BY_SUFFIX, check_rate, write_folder
from ciir.service.cli import common, output_path
from ciir.service.pipeline.focus.planes import refocus

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from ciir.renderer.writers.stacks import Stack, WriteStack


def run(args: argparse.Namespace) -> None:
    """Writes the planes, and prints a line about them."""
    output_path.check_places(args)
    options = common.parse_options(args, "plane")
    count = options.count_planes()
    write = _find_writer(args.out, count, options.fps)
    source = common.open_input(args, options)
    with common.progress_bar("picture") as progress:
        report = refocus(source, options, write, progress=progress)
    common.write_report(report, args.report)
    planes, array = report["planes"], report["lens_array"]
    scale = report["plan"]["scale"]
    size = f"{scale * array['rows']}x{scale * array['cols']} pixels ({common.format_timings(report)})"
    ends = " to ".join(plane["name"].rpartition("_")[2] for plane in (planes[0], planes[-1])[:count])
    what = f"{count} plane{'s' * (count > 1)}, {ends}" if options.all_in_focus == "no" else "in focus everywhere"
    common.print_line(f"{args.out}: {what}, of {size}")


def _find_writer(out: str, count: int, fps: float | None) -> Callable[[Stack], list[str]]:
    """Returns the function that writes `count` planes to `out`.

    Raises `InvalidOption` if it can't write them, or if `fps` is given but `out` is not a video.
    """
    writers, by_suffix = (PLANE, PLANE_BY_SUFFIX) if count == 1 else (STACK, STACK_BY_SUFFIX)
    what = "one plane" if count == 1 else "a stack of planes"
    if output_path.names_file(out, list(by_suffix), what=what):
        name = by_suffix[Path(out).suffix.lower()]
        check_rate(fps, name)
        return partial(_write_file, Path(out), writers[name])
    check_rate(fps, None)
    return partial(write_folder, Path(out))


def _write_file(path: Path, write: WriteStack, stack: Stack) -> list[str]:
    with replacing(path) as file:
        return write(file, stack)
