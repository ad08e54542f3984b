"""Collects the views of a reconstruction as one light field in memory."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.renderer.views import parse_views
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.whole import WholeWriter
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField
    from ciir.renderer.writers.writer import Contents
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Clock, Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source


class _Collector(WholeWriter):
    """Keeps the light field in memory."""

    name = "light field"
    light_field: LightField

    def begin(self, contents: Contents) -> None:
        """Accepts some of the views, too: the others stay black."""
        super().begin(replace(contents, views=tuple(parse_views("all", *contents.grid))))
        assert self._views is not None  # noqa: S101 - made by the line above
        self._views[:] = 0
        self._missing = len(contents.views)

    def encode(self, light_field: LightField) -> list[str]:
        """Writes nothing."""
        self.light_field = light_field
        return []


def collect_views(
    source: Source, options: Options, *, max_pixels: int | None, progress: Progress, clock: Clock
) -> tuple[LightField, Report]:
    """Returns a light field with the views that `options` ask for, where all others are black, and the report.

    Raises as `service.pipeline.run.reconstruct`.
    """
    writer = _Collector(io.BytesIO(), WriterOptions())
    report = reconstruct(source, options, writer, max_pixels=max_pixels, progress=progress, clock=clock)
    return writer.light_field, report
