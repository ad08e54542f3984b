"""The base class of all writers of views, the writer that keeps them in memory, and what writers share."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.readers.layout import DEPTH_SENSE_TEXT
from ciir.renderer.writers.formats import FORMATS_OF_TIMES

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import TracebackType
    from typing import Self

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import DepthSense, View

REPORT = "report.json"
ZIP_DATE = (1980, 1, 1, 0, 0, 0)
"""The earliest date of a zip, so that the same views make the same bytes."""


@dataclass(frozen=True)
class Contents:
    """Description of the views that a writer gets."""

    views: tuple[View, ...]
    """The views in the order in which they come."""
    grid: tuple[int, int]
    """Rows and columns of the light field's views; `views` may be some of them."""
    height: int
    """Height of a view, in pixels."""
    width: int
    channels: int
    """1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha."""
    dtype: np.dtype[np.uint8] | np.dtype[np.uint16]
    depth_sense: DepthSense = "lenses"
    times: tuple[float, ...] = ()
    """Times in seconds: the pictures are one view at several times, "views" (0, 0), (0, 1), ..., or at several yaws,
    between which no time passes; empty for a light field."""
    scale: int = 1
    """Pixels for each pixel of the views that were read, along each side."""
    pixel_aspect: float = 1.0
    """See `LightField.pixel_aspect`."""
    is_mesh: bool = False
    """Whether the views are rendered, so that several times or yaws may be meant."""

    def name_file(self, view: View) -> str:
        """Returns `view_VV_UU.png`, or `frame_NNNN.png` for several times or yaws."""
        return f"frame_{view[1]:04d}.png" if self.times else file_name(view)

    @property
    def text(self) -> dict[str, str]:
        """What each PNG of a view states, by keyword."""
        return {} if self.times else {DEPTH_SENSE_TEXT: self.depth_sense}

    def refuse_times(self, name: str) -> None:
        """Raises `InvalidOption` for pictures at several times or yaws, unless the format `name` can hold them."""
        if self.times and name not in FORMATS_OF_TIMES:
            others = f"{', '.join(FORMATS_OF_TIMES[:-1])} or {FORMATS_OF_TIMES[-1]}"
            raise InvalidOption(f"format: {name} holds no pictures at several times or yaws; give {others}")

    @property
    def sample(self) -> Pixels:
        """A white, opaque pixel of the views' type, `(1, 1, C)`: only the views show whether they all are opaque."""
        return np.full((1, 1, self.channels), np.iinfo(self.dtype).max, self.dtype)


class Writer(ABC):
    """Takes the views of one reconstruction in a `with` block: `begin`, `write` for each view, `finish`.

    If the block ends without `finish`, no part of an output stays.
    """

    beside: Mapping[str, bytes] = {}
    """Files that go next to the output, by what their names add to its name; complete after `finish`."""

    @abstractmethod
    def begin(self, contents: Contents) -> None:
        """Prepares for `contents`, before any view is made.

        Raises `InvalidOption` if the format can't hold them.
        """

    @abstractmethod
    def write(self, view: View, pixels: Pixels) -> str:
        """Encodes and keeps view (v, u), `(H, W, C)`; returns its file name."""

    @abstractmethod
    def finish(self, report: dict[str, Any]) -> None:
        """Adds the report if the format holds one, and completes the output."""

    def discard(self) -> None:  # noqa: B027 - most writers have nothing to remove
        """Removes what was written before `finish`; does nothing after it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()


class MemoryWriter(Writer):
    """Keeps each view's pixels, `(H, W, C)`, in `views` by (v, u)."""

    def __init__(self) -> None:
        self.views: dict[View, Pixels] = {}

    def begin(self, contents: Contents) -> None:
        """Accepts any views."""

    def write(self, view: View, pixels: Pixels) -> str:
        """Keeps the array itself, not a copy."""
        self.views[view] = pixels
        return file_name(view)

    def finish(self, report: dict[str, Any]) -> None:
        """Does nothing: `service.pipeline.run.reconstruct` returns the report."""


def file_name(view: View) -> str:
    """Returns `view_VV_UU.png`."""
    return f"view_{view[0]:02d}_{view[1]:02d}.png"


def report_json(report: Mapping[str, Any]) -> bytes:
    """Returns a report as it is written everywhere: UTF-8, indented, with a line end."""
    return (json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
