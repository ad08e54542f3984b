"""Writes one view as a picture."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.writers.pictures.registry import FORMATS
from ciir.renderer.writers.writer import Writer

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.options import WriterOptions
    from ciir.renderer.writers.writer import Contents


class SingleWriter(Writer):
    """Writes one view into a binary file. A picture holds no report."""

    def __init__(self, file: IO[bytes], options: WriterOptions, name: str) -> None:
        self._file, self._options, self._picture = file, options, FORMATS[name]

    def begin(self, contents: Contents) -> None:
        """Refuses more than one view, and pixels that the format can't hold."""
        contents.refuse_times(self._picture.name)
        count = len(contents.views)
        if count != 1:
            folder = "a folder (a name without a suffix), " if self._options.name else ""
            raise InvalidOption(
                f"format: {self._picture.name} holds one view and {count} are asked for; give {folder}zip or npz, or "
                "one view"
            )
        self._picture.encode(contents.sample)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes the picture."""
        self._file.write(self._picture.encode(pixels))
        return f"view_{view[0]:02d}_{view[1]:02d}{self._picture.suffix}"

    def finish(self, report: dict[str, Any]) -> None:
        """Adds nothing."""
