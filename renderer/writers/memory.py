"""Keeps views in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ciir.renderer.writers.writer import Writer, file_name

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View


class MemoryWriter(Writer):
    """Keeps each view's pixels, `(H, W, C)`, in `views` by (v, u)."""

    def __init__(self) -> None:
        self.views: dict[View, Pixels] = {}

    def begin(self, count: int, sample: Pixels) -> None:
        """Any views can be kept."""

    def write(self, view: View, pixels: Pixels) -> str:
        """Keeps the array itself, not a copy."""
        self.views[view] = pixels
        return file_name(view)

    def finish(self, report: dict[str, Any]) -> None:
        """Nothing is left to do: `service.pipeline.run.reconstruct` returns the report."""
