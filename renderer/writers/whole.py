"""The base class of writers that need the whole light field before they can write any of it."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.writers.formats import FORMATS_OF_TIMES
from ciir.renderer.writers.writer import Writer, file_name

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import DepthSense, View
    from ciir.renderer.writers.options import WriterOptions
    from ciir.renderer.writers.writer import Contents

REVERSED = "{name} counts {what}: views are written in reversed order in v and in u, which is the same light field"
"""The note of formats that have a depth sense, on a light field with the other one."""


class WholeWriter(Writer):
    """Collects all views, and writes them as one light field when the last one has arrived."""

    sense: DepthSense | None = None
    """The depth sense that the format has; None for one that states it, or that holds pictures of another kind."""
    holds_alpha = True

    def __init__(self, file: IO[bytes], options: WriterOptions, name: str) -> None:
        self.file, self.options, self.name = file, options, name
        self._views: Pixels | None = None
        self._contents: Contents | None = None
        self._missing = 0
        self._notes: list[str] = []

    def check(self, contents: Contents) -> None:
        """Raises `InvalidOption` if the format can't hold the light field, before any view is made."""

    @abstractmethod
    def encode(self, light_field: LightField) -> list[str]:
        """Writes the light field, which has the depth sense `sense`, to `file`.

        Returns notes on what the format doesn't hold, or holds in another way.
        """

    def begin(self, contents: Contents) -> None:
        """Refuses a part of the views."""
        contents.refuse_times(self.name)
        rows, columns = contents.grid
        if len(contents.views) != rows * columns:
            turn = ", or rotate 0:360:60 for a turntable" if contents.is_mesh and self.name in FORMATS_OF_TIMES else ""
            raise InvalidOption(
                f"format: {self.name} needs all views, and {len(contents.views)} of {rows}x{columns} are asked "
                f"for; give views all{turn}"
            )
        self.check(contents)
        shape = (rows, columns, contents.height, contents.width, contents.channels)
        self._views, self._contents = np.empty(shape, contents.dtype), contents
        self._missing = len(contents.views)

    def write(self, view: View, pixels: Pixels) -> str:
        """Keeps a copy of the view; with the last one, writes the file."""
        assert self._views is not None  # noqa: S101 - `begin` was called: the contract of Writer
        assert self._contents is not None  # noqa: S101
        self._views[view] = pixels
        self._missing -= 1
        if self._missing == 0:
            light_field = LightField(
                self._views,
                notes=(),
                is_ordered=True,
                depth_sense=self._contents.depth_sense,
                pixel_aspect=self._contents.pixel_aspect,
            )
            self._notes = self._encode(light_field)
        return file_name(view)

    def _encode(self, light_field: LightField) -> list[str]:
        """Writes the light field as the format holds it: with its depth sense, and without alpha if it has none.

        Raises `InvalidOption` if that alpha is not opaque, which only the pixels show.
        """
        notes = []
        if not self.holds_alpha and light_field.views.shape[4] in (2, 4):
            if light_field.is_transparent():
                raise InvalidOption(f"format: {self.name} holds no alpha; give views without it, or format npz")
            light_field = replace(light_field, views=light_field.views[..., :-1])
            notes.append(f"{self.name} holds no alpha: it is left out, and was opaque everywhere")
        if self.sense not in (None, light_field.depth_sense):
            what = "cameras" if self.sense == "cameras" else "pixels under lenses"
            notes.append(REVERSED.format(name=self.name, what=what))
            light_field = light_field.with_depth_sense(self.sense)
        return [*notes, *self.encode(light_field)]

    def finish(self, report: dict[str, Any]) -> None:
        """Adds notes to the report."""
        report["notes"] += self._notes

    def discard(self) -> None:
        """Releases the views."""
        self._views = None
