"""Makes the writers of formats of one file."""

from __future__ import annotations

from importlib import import_module
from typing import IO, TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.writers.formats import FORMATS, check_options
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.writer import Writer

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.formats import Format
    from ciir.renderer.writers.writer import Contents


def make_writer(entry: Format, file: IO[bytes], options: WriterOptions) -> Writer:
    """Returns a writer to a binary file. Raises `InvalidOption` for an option that the format does not use."""
    check_options(options, entry.uses, f"format {entry.name}")
    module, _, class_ = entry.writer.partition(":")
    made: Writer = getattr(import_module(f"ciir.renderer.writers.{module}"), class_)(file, options, entry.name)
    return made


class FileWriter(Writer):
    """Writes one file in the requested format; without one, PNG for one view and zip for several."""

    def __init__(self, file: IO[bytes], wanted: str | None, options: WriterOptions | None = None) -> None:
        if wanted is not None and wanted not in FORMATS:
            raise InvalidOption(f"format: {wanted[:40]!r} is not known; give {', '.join(FORMATS)}")
        self._file = file
        self._wanted = wanted
        self._options = options or WriterOptions()
        self._writer: Writer | None = None
        self.format = FORMATS["zip"]
        """The format; final from `begin` on."""

    def begin(self, contents: Contents) -> None:
        """Selects the format."""
        self.format = FORMATS[self._wanted or ("png" if len(contents.views) == 1 else "zip")]
        self._writer = make_writer(self.format, self._file, self._options)
        self._writer.begin(contents)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes the view."""
        assert self._writer is not None  # noqa: S101 - `begin` was called: the contract of Writer
        return self._writer.write(view, pixels)

    def finish(self, report: dict[str, Any]) -> None:
        """Completes the file."""
        assert self._writer is not None  # noqa: S101
        self._writer.finish(report)

    def discard(self) -> None:
        """Closes an archive that is not finished."""
        if self._writer is not None:
            self._writer.discard()
