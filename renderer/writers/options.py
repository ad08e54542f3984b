"""How a light field is written, as far as its format leaves that open."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Mapping

PathName = Literal["circle", "sweep", "spiral"]
"""Paths of a camera among the views."""


@dataclass(frozen=True)
class WriterOptions:
    """How a light field is written. A writer uses what its format leaves open."""

    suffix: str = ""
    """Of the file's name, in lower case, for formats that have several; empty: the format's usual one."""
    device: str = ""
    """The display that a quilt is for, of `renderer.displays.devices`; empty: the usual one, and the own aspect."""
    path: PathName = "circle"
    """Of the camera, in videos: `renderer.writers.containers.camera_paths.list_positions`."""
    frames: int = 60
    """In a video."""
    fps: float | None = None
    """Frames per second of a video; None: 30, or of pictures at several times as many as let them pass as they do."""
    epi: str = ""
    """The line of an EPI picture, as `EpiLine.parse` reads it; empty: the middle row of the centre view."""

    @classmethod
    def convert(cls, given: Mapping[str, Any]) -> WriterOptions:
        """Options by name. Raises `InvalidOption` for a name that is not known; the suffix is the path's."""
        known = [field.name for field in fields(cls) if field.name != "suffix"]
        unknown = sorted(given.keys() - set(known))
        if unknown:
            raise InvalidOption(f"{unknown[0][:40]!r}: no such option; known are {', '.join(known)}")
        return cls(**given)


@dataclass(frozen=True)
class EpiLine:
    """A line through the light field: a row `y` of the views of row `v`, or a column `x` of the views of column `u`.

    The other two are None, and `v` or `u` is None for the row or column of the centre view.
    """

    y: int | None = None
    x: int | None = None
    v: int | None = None
    u: int | None = None

    @classmethod
    def parse(cls, text: str) -> EpiLine:
        """`y=120`, `y=120,v=4`, `x=80` or `x=80,u=4`; empty text is no line. Raises `InvalidOption`."""
        match = re.fullmatch(r"(?:y=(\d{1,6})(?:,v=(\d{1,6}))?|x=(\d{1,6})(?:,u=(\d{1,6}))?)?", text)
        if match is None:
            raise InvalidOption(
                f"epi: {text[:40]!r} is not understood; give a row y=120 or a column x=80, or y=120,v=4"
            )
        y, v, x, u = (None if group is None else int(group) for group in match.groups())
        return cls(y, x, v, u)
