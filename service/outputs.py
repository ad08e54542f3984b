"""Writes a reconstruction to a file or a folder, depending on its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import BY_SUFFIX, BY_SUFFIX_OF_TIMES, check_options
from ciir.service.pipeline import run

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source


def write_file(
    source: Source, options: Options, path: Path, name: str = "", *, progress: Progress | None = None
) -> Report:
    """Writes the views in the format `name`, by default that of the suffix.

    Raises the same errors as `service.pipeline.run.reconstruct`.
    """
    suffix = path.suffix.lower()
    formats = BY_SUFFIX_OF_TIMES if options.moments else BY_SUFFIX
    given = name or formats[suffix].name, options.make_writer_options(suffix, path.name)
    with replacing(path) as file, FileWriter(file, *given) as writer:
        return run.reconstruct(source, options, writer, progress=progress)


def write_folder(
    source: Source, options: Options, path: Path, *, given: Path | None = None, progress: Progress | None = None
) -> Report:
    """Writes the views and the report to a folder, but not over `given`, the input.

    Raises the same errors as `write_file`.
    """
    check_options(options, (), "a folder of views")
    with FolderWriter(path, given) as writer:
        return run.reconstruct(source, options, writer, progress=progress)
