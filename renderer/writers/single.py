"""Writes one view as a picture."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.writers.writer import Writer

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.pictures import PictureFormat


class SingleWriter(Writer):
    """Writes one view into a binary file. A picture holds no report."""

    def __init__(self, file: IO[bytes], picture: PictureFormat) -> None:
        self._file, self._picture = file, picture

    def begin(self, count: int, sample: Pixels) -> None:
        """Refuses more than one view, and pixels that the format can't hold."""
        if count != 1:
            raise InvalidOption(
                f"format: {self._picture.name} holds one view and {count} are asked for; give zip or npz, or one view"
            )
        self._picture.encode(sample)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes the picture."""
        self._file.write(self._picture.encode(pixels))
        return f"view_{view[0]:02d}_{view[1]:02d}{self._picture.suffixes[0]}"

    def finish(self, report: dict[str, Any]) -> None:
        """Adds nothing."""
