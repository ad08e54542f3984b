"""Collects the views of a reconstruction as one light field in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.writer import Writer, file_name
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Clock, Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source


class _Collector(Writer):
    """Keeps all views, or the rows of views from the first written one to the last."""

    light_field: LightField

    def __init__(self, *, crops_rows: bool) -> None:
        self._crops_rows, self._first = crops_rows, 0

    def begin(self, contents: Contents) -> None:
        """Prepares black views."""
        contents.refuse_times("a light field")
        rows, columns = contents.grid
        if self._crops_rows:
            written = [v for v, _ in contents.views]
            self._first, rows = min(written), max(written) - min(written) + 1
        shape = rows, columns, contents.height, contents.width, contents.channels
        self.light_field = LightField(
            np.zeros(shape, contents.dtype),
            notes=(),
            is_ordered=True,
            depth_sense=contents.depth_sense,
            pixel_aspect=contents.pixel_aspect,
        )

    def write(self, view: View, pixels: Pixels) -> str:
        """Keeps a copy of the view."""
        self.light_field.views[view[0] - self._first, view[1]] = pixels
        return file_name(view)

    def finish(self, report: dict[str, Any]) -> None:
        """Does nothing: `collect_views` returns the report."""


def collect_views(
    source: Source,
    options: Options,
    *,
    crops_rows: bool = False,
    max_pixels: int | None,
    progress: Progress,
    clock: Clock,
) -> tuple[LightField, Report]:
    """Returns the views that `options` ask for as a light field, and the report.

    Its other views are black. With `crops_rows`, there are only the rows of views from the first of them to the last,
    so that `max_pixels` limits the memory too. Raises the same errors as `service.pipeline.run.reconstruct`.
    """
    writer = _Collector(crops_rows=crops_rows)
    report = reconstruct(source, options, writer, max_pixels=max_pixels, progress=progress, clock=clock)
    return writer.light_field, report
