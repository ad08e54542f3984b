"""Passes one view of a mesh at several times or yaws to a writer as frames."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ciir.renderer.writers.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents
    from ciir.service.pipeline.options import Moment
    from ciir.service.pipeline.report import Report


class FrameWriter(Writer):
    """Passes the view of one reconstruction after another to `writer`, as the pictures for `times`."""

    def __init__(self, writer: Writer, times: tuple[float, ...]) -> None:
        self._writer, self._times = writer, times
        self._done = 0

    def begin(self, contents: Contents) -> None:
        """Begins the writer, before the first picture."""
        if self._done == 0:
            grid = 1, len(self._times)
            frames = tuple((0, number) for number in range(len(self._times)))
            self._writer.begin(replace(contents, views=frames, grid=grid, times=self._times))

    def write(self, view: View, pixels: Pixels) -> str:  # noqa: ARG002 - there is one
        """Writes the next picture."""
        self._done += 1
        return self._writer.write((0, self._done - 1), pixels)

    def finish(self, report: dict[str, Any]) -> None:
        """Does nothing: the report covers all frames."""


def join_reports(reports: Sequence[Report], moments: Sequence[Moment]) -> Report:
    """Joins the reports: the first one, with each frame's picture and the notes that differ in more than numbers."""
    notes: dict[str, str] = {}
    for report in reports:
        for note in report["notes"]:
            notes.setdefault(re.sub(r"\d[\d,.]*", "", note), note)
    views = [moment | report["views"][0] for moment, report in zip(moments, reports, strict=True)]
    return {**reports[0], "views": views, "notes": list(notes.values()), "timings_ms": reports[-1]["timings_ms"]}
