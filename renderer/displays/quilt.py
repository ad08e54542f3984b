"""Quilts: a lenticular display's views in one picture, with the layout in its name and in a JSON file next to it.

View 0, from the leftmost camera, is the tile at the bottom left; views continue to the right, then upwards
(https://lookingglassfactory.com/tutorial/what-is-a-quilt).
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption, Unreadable

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels

MAX_TILES = 64
"""Most columns, and most rows, of a quilt."""
MAX_ASPECT = 100.0
_NAME = re.compile(r"_qs(\d{1,3})x(\d{1,3})(?:a(\d{1,3}(?:\.\d{1,12})?)|(?![a-z\d]))", re.IGNORECASE)


@dataclass(frozen=True)
class QuiltLayout:
    """`cols x rows` tiles, each a view whose width is `aspect` times its height as the display shows it.

    Raises `InvalidOption` if a number is out of range.
    """

    cols: int
    rows: int
    aspect: float
    is_inverted: bool = False
    """Whether view 0 is from the rightmost camera."""

    def __post_init__(self) -> None:
        if not (1 <= self.cols <= MAX_TILES and 1 <= self.rows <= MAX_TILES):
            raise InvalidOption(
                f"quilt: {self.cols}x{self.rows} is out of range; give columns x rows, 1 to {MAX_TILES} of each"
            )
        if not 1 / MAX_ASPECT <= self.aspect <= MAX_ASPECT:
            raise InvalidOption(
                f"aspect: {self.aspect:g} is out of range; give a view's width / height, from {1 / MAX_ASPECT:g} to "
                f"{MAX_ASPECT:g}"
            )

    @property
    def count(self) -> int:
        """Number of views."""
        return self.cols * self.rows

    @property
    def suffix(self) -> str:
        """End of the file's name, before `.png`: `_qs8x6a0.75`."""
        return f"_qs{self.cols}x{self.rows}a{self.aspect:.6g}"

    def to_json(self) -> str:
        """Returns the file next to the picture, `NAME.png.json`, with the keys that Looking Glass' software reads."""
        settings = {"viewX": self.cols, "viewY": self.rows, "viewTotal": self.count, "aspect": self.aspect}
        return json.dumps({**settings, "invertViews": False}, indent=2) + "\n"


@dataclass(frozen=True)
class QuiltName:
    """The layout in a quilt's name, with or without an aspect. Raises the errors of `QuiltLayout`."""

    cols: int
    rows: int
    aspect: float | None = None

    def __post_init__(self) -> None:
        self.complete(1.0)

    @property
    def suffix(self) -> str:
        """The suffix of `QuiltLayout`, or `_qs8x6` without an aspect."""
        return f"_qs{self.cols}x{self.rows}" if self.aspect is None else self.complete(self.aspect).suffix

    def complete(self, aspect: float) -> QuiltLayout:
        """Returns the layout, with `aspect` if the name has none."""
        return QuiltLayout(self.cols, self.rows, aspect if self.aspect is None else self.aspect)


def parse_name(name: str) -> QuiltName | None:
    """Returns the last layout in a file's name, `duck_qs8x6a0.75.png` or `duck_qs8x6.png`, with columns, rows and
    perhaps the aspect, or None if there is none.

    Raises `InvalidOption` if its numbers are out of range.
    """
    found = [*_NAME.finditer(name.rpartition("/")[2])]
    if not found:
        return None
    cols, rows, aspect = found[-1].groups()
    return QuiltName(int(cols), int(rows), float(aspect) if aspect else None)


def parse_grid(text: str) -> tuple[int, int]:
    """Reads `8x6`, columns x rows of views. Raises `InvalidOption`."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX]\s*(\d{1,6})\s*", text)
    if match is None:
        raise InvalidOption(f"quilt: {text[:40]!r} is not understood; give columns x rows of views, such as 8x6")
    return int(match[1]), int(match[2])


def parse_json(data: bytes, *, name: str) -> QuiltLayout:
    """Returns the layout in the JSON file next to a quilt: `viewX`, `viewY`, `aspect` and perhaps `invertViews`, at the
    top level or in `quilt_settings`.

    Raises `Unreadable` if there is none, `InvalidOption` if a number is out of range.
    """
    try:
        found: Any = json.loads(data)
        found = found.get("quilt_settings", found)
        cols, rows = (int(min(found[key], 1e6)) for key in ("viewX", "viewY"))  # keeps numbers in messages short
        return QuiltLayout(cols, rows, float(found["aspect"]), found.get("invertViews") is True)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        if isinstance(error, InvalidOption):
            raise
        raise Unreadable(
            f"{name}: not a quilt's layout; give JSON with viewX (columns), viewY (rows) and aspect, or name the "
            "picture NAME_qs8x6a0.75.png"
        ) from error


def join_views(views: Pixels, layout: QuiltLayout) -> Pixels:
    """Returns the quilt `(rows*h, cols*w, c)` of `layout.count` views `(n, h, w, c)`, from the leftmost camera on."""
    _, height, width, channels = views.shape
    tiles = views.reshape(layout.rows, layout.cols, height, width, channels)[::-1]  # from the top row
    return tiles.transpose(0, 2, 1, 3, 4).reshape(layout.rows * height, layout.cols * width, channels)


def split_quilt(quilt: Pixels, layout: QuiltLayout, *, name: str) -> Pixels:
    """Returns the views `(n, h, w, c)` of a quilt, from the leftmost on: the inverse of `join_views`, also for inverted
    layouts.

    Pixels beyond whole tiles, at the right and at the top, are ignored, as displays do with quilts whose size is not a
    multiple of the layout. Raises `InvalidOption` if a tile would have no pixel.
    """
    height, width = quilt.shape[0] // layout.rows, quilt.shape[1] // layout.cols
    if not height or not width:
        raise InvalidOption(
            f"{name}: {quilt.shape[1]}x{quilt.shape[0]} pixels (width x height) are too few for {layout.cols}x"
            f"{layout.rows} views; give the columns and rows that the quilt has"
        )
    whole = quilt[quilt.shape[0] - layout.rows * height :, : layout.cols * width]
    tiles = whole.reshape(layout.rows, height, layout.cols, width, -1).transpose(0, 2, 1, 3, 4)[::-1]
    views = tiles.reshape(layout.count, height, width, quilt.shape[2])
    return views[::-1] if layout.is_inverted else views
