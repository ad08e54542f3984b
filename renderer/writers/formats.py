"""The formats that views are written in as one file: one registry.

Picture formats come from `renderer.writers.pictures.registry`. A format for several views is a module with its
`Writer`, and a line in `FORMATS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import IO, TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.writers import pictures
from ciir.renderer.writers.archives import NpzWriter, ZipWriter
from ciir.renderer.writers.html import HtmlWriter
from ciir.renderer.writers.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents


class SingleWriter(Writer):
    """Writes one view into a binary file. A picture holds no report."""

    def __init__(self, file: IO[bytes], picture: pictures.PictureFormat) -> None:
        self._file, self._picture = file, picture

    def begin(self, contents: Contents) -> None:
        """Refuses more than one view, and pixels that the format can't hold."""
        count = len(contents.views)
        if count != 1:
            raise InvalidOption(
                f"format: {self._picture.name} holds one view and {count} are asked for; give zip or npz, or one view"
            )
        self._picture.encode(contents.sample)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes the picture."""
        self._file.write(self._picture.encode(pixels))
        return f"view_{view[0]:02d}_{view[1]:02d}{self._picture.suffixes[0]}"

    def finish(self, report: dict[str, Any]) -> None:
        """Adds nothing."""


@dataclass(frozen=True)
class Format:
    """A format of one file."""

    name: str
    suffixes: tuple[str, ...]
    """Of file names, lower case."""
    media_type: str
    open: Callable[[IO[bytes]], Writer]
    """Makes a writer into a binary file."""
    holds_report: bool
    """Whether the report, and with it the times of that run, is in the file."""


FORMATS = {
    entry.name: entry
    for entry in (
        *(
            Format(picture.name, picture.suffixes, picture.media_type, partial(SingleWriter, picture=picture), False)
            for picture in pictures.FORMATS
        ),
        Format("zip", (".zip",), "application/zip", ZipWriter, True),
        Format("npz", (".npz",), "application/x-npz", NpzWriter, True),
        Format("html", (".html",), "text/html", HtmlWriter, False),
    )
}
"""By name."""
BY_SUFFIX = {suffix: entry for entry in FORMATS.values() for suffix in entry.suffixes}


def check_format(name: str) -> None:
    """Raises `InvalidOption` where `name` is no format of `FORMATS`."""
    if name not in FORMATS:
        raise InvalidOption(f"format: {name[:40]!r} is not known; give {', '.join(FORMATS)}")


class FileWriter(Writer):
    """Writes one file in the format that was asked for; without one, PNG for one view and zip for several."""

    def __init__(self, file: IO[bytes], wanted: str | None) -> None:
        if wanted is not None:
            check_format(wanted)
        self._file = file
        self._wanted = wanted
        self._writer: Writer | None = None
        self.format = FORMATS["zip"]
        """Final from `begin` on."""

    def begin(self, contents: Contents) -> None:
        """Selects the format."""
        self.format = FORMATS[self._wanted or ("png" if len(contents.views) == 1 else "zip")]
        self._writer = self.format.open(self._file)
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
