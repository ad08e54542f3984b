"""Options for writing a light field, as far as its format leaves them open."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.displays.quilt import MAX_ASPECT
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.bundle import read_file

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Self

    from ciir.renderer.displays.panel import Conversion

TEXT_FILES = ("calibration", "display")
"""Options whose value is the text of a file."""
MOST_TEXT = 1 << 16
"""Most bytes of that text."""
RANGES: dict[str, tuple[float, float]] = {
    "aspect": (1 / MAX_ASPECT, MAX_ASPECT),
    "lpi": (1, 1000),
    "dpi": (1, 100_000),
    "view_angle": (1, 120),
    "disparity": (-1000, 1000),
    "frames": (1, 3600),
    "fps": (1, 240),
}
"""The smallest and the largest value of each number in `FormatOptions`."""
PathName = Literal["circle", "sweep", "spiral"]
"""Paths of a camera among the views."""


@dataclass(frozen=True)
class FormatOptions:
    """How a light field is written. Each format uses some of these options."""

    device: str = ""
    """The display that a quilt is for, from `renderer.displays.devices`; empty: the default one, with the views' own
    aspect."""
    quilt: str = ""
    """Columns x rows of a quilt, as `parse_grid` reads them; empty: the device's."""
    aspect: float | None = None
    """Width / height that a display shows a quilt's views with; None: the device's, or the views' own."""
    calibration: str = ""
    """A lenticular display's JSON, as `renderer.displays.lenticular.parse_calibration` reads it."""
    print: str = ""
    """Size of a lenticular print, as `renderer.displays.prints.parse_size` reads it."""
    lpi: float | None = None
    """Lenses per inch of a print's lens sheet."""
    dpi: float | None = None
    """Pixels per inch of a print."""
    view_distance: str = ""
    """Distance of a print's viewer, as `renderer.displays.prints.parse_distance` reads it; empty: the print is 14°
    high from there."""
    view_angle: float | None = None
    """Viewing angle of a print's lens sheet in degrees; None: 40."""
    display: str = ""
    """A panel and its lenses as TOML, as `renderer.displays.integral.parse_display` reads it."""
    conversion: Conversion = "spoc"
    """Conversion of a panel's picture."""
    disparity: float | None = None
    """Disparity of what lies in a display's plane, in pixels from view to view, larger for nearer content; None: 0."""
    path: PathName = "circle"
    """Path of the camera in videos: see `renderer.writers.containers.camera_paths.list_positions`."""
    frames: int = 60
    """Number of frames in a video."""
    fps: float | None = None
    """Frames per second of a video; None: 30, or, for pictures at several times, the rate at which those times pass."""
    epi: str = ""
    """The line of an EPI picture, as `parse_epi` reads it; empty: the middle row of the centre view."""

    @classmethod
    def convert(cls, given: Mapping[str, Any]) -> Self:
        """Returns the options by name; None is the default. `calibration` and `display` are paths.

        Raises `InvalidOption` for a name that is not known or a value out of range, and `Unreadable` for a file that
        can't be read.
        """
        known = [field.name for field in fields(FormatOptions)]
        unknown = sorted(given.keys() - set(known))
        if unknown:
            raise InvalidOption(f"{unknown[0][:40]!r}: no such option; the options are {', '.join(known)}")
        given = {
            name: value.item() if isinstance(value, np.generic) else value
            for name, value in given.items()
            if value is not None
        }
        for name in TEXT_FILES:
            if not isinstance(given.get(name, ""), (str, PathLike)):
                raise InvalidOption(f"{name}: {str(given[name])[:40]!r} is not accepted; give a path")
        files = {name: read_description(name, Path(given[name])) for name in TEXT_FILES if given.get(name)}
        for name, value in given.items():
            is_number, is_whole = name in RANGES, isinstance(getattr(cls, name), int)
            kinds = int if is_whole else (int, float) if is_number else str
            if name not in files and (isinstance(value, bool) or not isinstance(value, kinds)):
                needed = "a whole number" if is_whole else "a number" if is_number else "text"
                raise InvalidOption(f"{name}: {str(value)[:40]!r} is not accepted; give {needed}")
            least, most = RANGES.get(name, (0, 0))
            if is_number and not least <= value <= most:
                raise InvalidOption(f"{name}: {str(value)[:40]} is out of range; give {least:g} to {most:g}")
        return cls(**{**given, **files})

    def make_writer_options(self, suffix: str = "", name: str = "") -> WriterOptions:
        """Makes the options for a writer to a file with that suffix and name."""
        given = {field.name: getattr(self, field.name) for field in fields(FormatOptions)}
        return WriterOptions(**given, suffix=suffix, name=name)


@dataclass(frozen=True)
class WriterOptions(FormatOptions):
    """The options of a format, and what the output's path says."""

    suffix: str = ""
    """Suffix of the file's name, in lower case, for formats that have several; empty: the format's usual one."""
    name: str = ""
    """Name of the file, if it has one: a quilt's may contain its layout."""


def read_description(name: str, path: Path) -> str:
    """Returns the text of the display's file for the option `name` of `TEXT_FILES`; errors in it name the file.

    Raises as `read_text` does, and as `parse_calibration` or `parse_display` does.
    """
    from ciir.renderer.displays.integral import parse_display  # imported here: clients of a server don't need them
    from ciir.renderer.displays.lenticular import parse_calibration

    text = read_text(path)
    parse = parse_calibration if name == "calibration" else parse_display
    parse(text.encode(), name=str(path), max_pixels=sys.maxsize)  # the limit on pixels is that of the run
    return text


def read_text(path: Path) -> str:
    """Returns the text of a small file. Raises `Unreadable`, and `TooLarge` over `MOST_TEXT` bytes."""
    return decode_text(read_file(path, DEFAULT_LIMITS), str(path))


def decode_text(data: bytes, name: str) -> str:
    """Returns the text of a file's bytes, as `read_text` does. `name`: the file's name in messages."""
    if len(data) > MOST_TEXT:
        raise TooLarge(f"{name}: over {MOST_TEXT:,} bytes; give the file that describes the display")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise Unreadable(f"{name}: not text in UTF-8; give the file that describes the display") from error


def parse_epi(text: str) -> dict[str, int]:
    """Returns the numbers in `y=120`, `y=120,v=4`, `x=80` or `x=80,u=4`, by name, as `LightField.epi` takes them; none
    for empty text. Raises `InvalidOption`.
    """
    if re.fullmatch(r"(y=\d{1,6}(,v=\d{1,6})?|x=\d{1,6}(,u=\d{1,6})?)?", text) is None:
        raise InvalidOption(f"epi: {text[:40]!r} is not understood; give a row y=120 or a column x=80, or y=120,v=4")
    return {name: int(number) for name, number in re.findall(r"(\w)=(\d+)", text)}
