"""The report of a reconstruction: what was read, what was done, and how long each stage took."""

from __future__ import annotations

import platform
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal, get_args

from ciir.renderer.readers.picture_sizes import read_start

if TYPE_CHECKING:
    from ciir.service.pipeline.job import Job

Stage = Literal["decode", "plan", "render", "map", "upscale", "focus", "encode"]
STAGES = get_args(Stage)
"""Stages in the order of the work; `total` follows."""

Report = dict[str, Any]
"""A report, ready for JSON. `service.pipeline.run` puts its keys together."""


class _Nested(threading.local):
    seconds = 0.0
    """Time spent in stages inside the one that this thread is in."""


class Clock:
    """Counts wall-clock milliseconds for each stage.

    Several threads may be in a stage; their times add up. A stage inside another one of its thread counts once.
    """

    def __init__(self) -> None:
        self._begun = time.perf_counter()
        self._lock = threading.Lock()
        self._seconds: dict[str, float] = {}
        self._nested = _Nested()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of the block for `name`, one of `STAGES`, even if the block raises."""
        before, self._nested.seconds = self._nested.seconds, 0.0
        begun = time.perf_counter()
        try:
            yield
        finally:
            took = time.perf_counter() - begun
            with self._lock:
                self._seconds[name] = self._seconds.get(name, 0.0) + took - self._nested.seconds
            self._nested.seconds = before + took

    def timings_ms(self) -> dict[str, float]:
        """Returns the milliseconds of the stages that ran, and `total` up to now."""
        seconds = {stage: self._seconds[stage] for stage in STAGES if stage in self._seconds}
        seconds["total"] = time.perf_counter() - self._begun
        return {stage: round(1000.0 * s, 3) for stage, s in seconds.items()}


class CountedFiles(Mapping[str, bytes]):
    """A bundle's files, with the sizes of those that were read."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files
        self.sizes: dict[str, int] = {}

    def __getitem__(self, key: str) -> bytes:
        data = self._files[key]
        self.sizes[key] = len(data)
        return data

    def read_start(self, key: str, length: int) -> bytes | None:
        """Reads the start of a file as `picture_sizes.StartReader.read_start` does. It is not counted."""
        return read_start(self._files, key, length)

    def __contains__(self, key: object) -> bool:
        return key in self._files

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def skip_reasons(skipped: Mapping[str, Any] | None) -> list[str]:
    """Describes in one sentence what `plan.skipped` counts; empty if nothing was skipped."""
    culled, uniform = ((skipped or {}).get(name, 0.0) for name in ("culled", "uniform"))
    parts = [f"{format_percent(culled)} of the triangles, which no ray meets"] if culled else []
    if uniform:
        parts.append(f"the model for {format_percent(uniform)} of its pixels, which are uniform background")
    return [f"skipped: {', and '.join(parts)}"] if parts else []


def format_percent(share: float) -> str:
    """Formats a share as a whole number of per cent, without rounding to none or all of it."""
    if share < 0.005:
        return "under 1 %"
    return f"{100 * share:.0f} %" if share < 0.995 or share == 1 else "over 99 %"


def find_versions(*packages: str) -> dict[str, str]:
    """Returns the versions of this package, Python, and the `packages` that were used."""
    return {name: _find_version(name) for name in ("ciir", "python", *packages)}


@cache
def _find_version(name: str) -> str:
    """Returns the version of a package. Looked up once, because it takes a third of a millisecond."""
    return platform.python_version() if name == "python" else version(name)


def describe_array(job: Job) -> Report:
    """Returns the report's `lens_array`; pitch and delta are null if they are unknown."""
    rows, cols, pixels_v, pixels_u = *job.lenses, *job.grid
    counts = {"rows": rows, "cols": cols, "pitch": job.pitch, "pixels_v": pixels_v, "pixels_u": pixels_u}
    return counts | {"delta": job.delta, "depth_sense": job.depth_sense}
