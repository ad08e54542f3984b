"""The messages to and from workers. They are small, because each goes through the scheduler."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ciir.renderer.views import View
    from ciir.service.pipeline.options import Options

Status = Literal["done", "kept", "failed", "cut"]
"""`kept`: it was done by an earlier run; `cut`: it is to be done in parts."""


@dataclass(frozen=True)
class Request:
    """Settings that are the same for all tasks of a batch."""

    options: Options
    outputs: str
    """The folder for the outputs: an absolute path or a URL."""
    run: str = ""
    """An id of this run of the batch. Outputs that this run made, and whose worker then died, count as done."""
    white: str | None = None
    """Paths of the white and the dark frame for raw lenslet pictures."""
    dark: str | None = None


@dataclass(frozen=True)
class Part:
    """A part of a task: some views of a light field, or some frames of a video."""

    name: str
    views: tuple[View, ...] = ()
    model: str = ""
    """The model that was selected for all views together."""
    first: int = 0
    """Number of the first frame, from 0."""
    times: tuple[float, ...] = ()
    """Times of the frames in seconds."""


@dataclass(frozen=True)
class Task:
    """One input and the name of its output, or a part of them."""

    source: str
    """An absolute path, a URL or `scene:NAME`."""
    out: str
    """Relative to the folder of the outputs, with `/`."""
    is_file: bool = False
    """Whether the output is a file in the format of its suffix, not a folder of views."""
    is_video: bool = False
    """Whether the input is a video of elemental image arrays, and the output has a picture for each frame."""
    part: Part | None = None
    whole: str = ""
    """The output that a part belongs to."""
    joined: tuple[Part, ...] = ()
    """The finished parts from which the output is to be made."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a task."""

    status: Status
    error: str = ""
    """One line, for a task that failed."""
    seconds: float = 0.0
    """Time that the worker took."""
    views: int = 0
    model: str = ""
    """The model that upscaled the views; empty for none."""
    notes: tuple[str, ...] = field(default=())
    """Notes from the report."""
    parts: tuple[Part, ...] = ()
    """The parts of a task that is to be cut."""
