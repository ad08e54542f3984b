"""Writes views that are in memory, or a whole light field, in the given format or the one that the name asks for."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.file_writer import make_writer
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import (
    BY_SUFFIX,
    BY_SUFFIX_OF_TIMES,
    WHOLE_BY_SUFFIX,
    check_options,
    find_display,
    find_implied,
    find_whole_format,
)
from ciir.renderer.writers.options import FormatOptions
from ciir.renderer.writers.writer import Contents

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import DepthSense, View
    from ciir.renderer.writers.formats import Format
    from ciir.renderer.writers.writer import Writer


def save_light_field(
    light_field: LightField, path: Path, name: str | None, options: FormatOptions, progress: Progress = ignore_progress
) -> tuple[str, ...]:
    """Writes a light field in the format `name`. If it is None, the format is the one that `options` or `path` ask for:
    a picture is an elemental image array, and a name without a suffix a folder of views.
    `progress` counts views, then the completed output.

    Returns notes on what the format doesn't hold, or holds in another way. Raises as `save_views` does.
    """
    views = light_field.views
    rows, columns, height, width, channels = views.shape
    sense = light_field.depth_sense
    positions = tuple(np.ndindex(rows, columns))
    array = {"rows": height, "cols": width, "pixels_v": rows, "pixels_u": columns, "depth_sense": sense}
    aspect = light_field.pixel_aspect
    contents = Contents(positions, (rows, columns), height, width, channels, views.dtype, sense, pixel_aspect=aspect)
    name = name or find_display(path, options) or find_implied(path, options)
    formats: Mapping[str, Format] | None = WHOLE_BY_SUFFIX
    if name is not None:
        found = find_whole_format(name, path)
        formats = None if found is None else {path.suffix.lower(): found}
    with _open(path, formats, options) as writer:
        notes = _write({view: views[view] for view in positions}, {"lens_array": array}, writer, contents, progress)
    for suffix, data in writer.beside.items():
        with _named_errors(path), replacing(path.with_name(path.name + suffix)) as file:
            file.write(data)
    return notes


def save_views(
    views: Mapping[View, Pixels],
    report: Mapping[str, Any],
    path: Path,
    grid: tuple[int, int],
    depth_sense: DepthSense,
    *,
    times: tuple[float, ...] = (),
) -> None:
    """Writes `views`, `(H, W, C)` by (v, u) of a light field with `grid` views, to a file or a folder; or one view at
    several `times`, in seconds, by (0, number), whose `views` the report then has.

    `report` is written with them if the format holds one.

    Raises `InvalidOption` if `path` can't be written or the format can't hold the views.
    """
    height, width, channels = (first := next(iter(views.values()))).shape
    scale = report.get("plan", {}).get("scale", 1)
    contents = Contents(tuple(views), grid, height, width, channels, first.dtype, depth_sense, times, scale)
    with _open(path, BY_SUFFIX_OF_TIMES if times else BY_SUFFIX, FormatOptions()) as writer:
        _write(views, report, writer, contents)


@contextmanager
def _open(path: Path, formats: Mapping[str, Format] | None, options: FormatOptions) -> Iterator[Writer]:
    """Opens a writer to `path`, in the format that its suffix has in `formats`, or to a folder; None: to a folder."""
    suffix = path.suffix.lower()
    with _named_errors(path):
        if formats is not None and suffix in formats:
            given = options.make_writer_options(suffix, path.name)
            with replacing(path) as file, make_writer(formats[suffix], file, given) as writer:
                yield writer
        elif formats is not None and suffix and not path.is_dir():
            known = ", ".join(formats)
            raise InvalidOption(
                f"{path}: {suffix} can't be written; end the name with {known}, or with none for a folder"
            )
        else:
            check_options(options, (), "a folder of views")
            with FolderWriter(path) as writer:
                yield writer


@contextmanager
def _named_errors(path: Path) -> Iterator[None]:
    """Raises `InvalidOption` in place of operating system errors."""
    try:
        yield
    except OSError as error:
        raise InvalidOption(f"{path}: {error.strerror}; name a place that can be written") from error


def _write(
    views: Mapping[View, Pixels],
    report: Mapping[str, Any],
    writer: Writer,
    contents: Contents,
    progress: Progress = ignore_progress,
) -> tuple[str, ...]:
    """Writes the views; returns the writer's notes."""
    writer.begin(contents)
    written = []
    for (v, u), picture in views.items():
        height, width = picture.shape[:2]
        named = report["views"][u] if contents.times else {"v": v, "u": u}
        written.append({**named, "file": writer.write((v, u), picture), "height": height, "width": width})
        progress(len(written), len(views) + 1)
    given = report.get("notes", [])
    completed = {**report, "notes": [*given], "views": written}
    writer.finish(completed)
    progress(len(views) + 1, len(views) + 1)
    return tuple(completed["notes"][len(given) :])
