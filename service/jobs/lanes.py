"""Two queues, so that small jobs never wait behind large ones."""

from __future__ import annotations

import io
import math
import os
import zipfile
from dataclasses import replace
from typing import TYPE_CHECKING, BinaryIO

from ciir.renderer.readers.registry import ZIP
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.service.pipeline.job import LENSES, PIXELS
from ciir.service.pipeline.options import NO_MODEL, Options

if TYPE_CHECKING:
    from ciir.service.jobs.job import Lane, Request

LANES: tuple[Lane, ...] = ("small", "large")
SMALL_ESTIMATE = 2.0
"""Most seconds of a small job, as `estimate_seconds` predicts them."""
SMALL_SECONDS = 5.0
"""Seconds after which a job in the small lane that keeps others waiting is moved to the large one."""
LARGE_FIRST_EVERY = 4
"""A thread prefers the large queue for one job in so many, so that large jobs run while small ones keep coming."""
_READ, _DRAW, _SAMPLE = 4e-7, 1.6e-7, 2.5e-7
"""Typical seconds of a byte that is read, of a triangle that OpenGL draws, and of a sample of a mesh."""
_UPSCALE, _WRITE = 1e-6, 1e-7
"""Typical seconds of an output pixel, with and without a model."""
_TRIANGLE_BYTES, _PIXEL_BYTES = 12, 0.25
"""Least bytes in usual files: three indices of 4 bytes; JPEG."""
_WINDOW = 25
"""Views that a light-field network takes for one."""
_DIRECTORY_BYTES = 1 << 20
"""Of the end of a zip, which holds its directory: enough for 10,000 files, and read in 0.1 s."""


def choose_lane(request: Request, file: BinaryIO) -> Lane:
    """`small` for a job of up to `SMALL_ESTIMATE`."""
    return "small" if estimate_seconds(request, measure_unpacked(file)) <= SMALL_ESTIMATE else "large"


def estimate_seconds(request: Request, size: float) -> float:
    """Seconds that `request` takes on a typical machine; a file of `size` unpacked bytes counts as a mesh if it may be
    one.

    What only the file's content shows, such as instances or the size of a picture, is not looked at.
    """
    options = Options.parse(request.options)
    if request.kind == "upscale":
        return size * (_READ + options.scale**2 / _PIXEL_BYTES * _UPSCALE)
    if request.kind == "elemental":
        options = replace(options, views="all", model=NO_MODEL)
    lenses, grid = math.prod(options.lenses or LENSES), math.prod(options.pixels or PIXELS)
    wanted = {"center": 1, "cross": 5, "all": grid}.get(options.views, options.views.count(";") + 1)
    rendered = wanted if options.model == NO_MODEL else min(_WINDOW * wanted, grid)
    samples = lenses * rendered * (LENSLET_SAMPLES if options.sampling == "lenslet" else 1) ** 2
    if options.strategy != "upscale":
        samples = max(samples, lenses * wanted * (LENSLET_SAMPLES * options.scale) ** 2)
    drawn = size / _TRIANGLE_BYTES * rendered if options.backend == "raster" else 0
    written = lenses * wanted * (_WRITE if options.model == NO_MODEL else options.scale**2 * _UPSCALE)
    return size * _READ + drawn * _DRAW + samples * _SAMPLE + written


def measure_unpacked(file: BinaryIO) -> float:
    """Bytes of `file`; of a zip those of its files unpacked, as its directory states them, or infinity without one that
    can be read. Nothing is unpacked.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    if not file.read(4).startswith(ZIP.signatures):
        return size
    file.seek(max(0, size - _DIRECTORY_BYTES))
    try:
        with zipfile.ZipFile(io.BytesIO(file.read())) as archive:
            return max(size, sum(member.file_size for member in archive.infolist()))
    except Exception:  # noqa: BLE001 - zipfile raises many kinds; the worker process reports what is wrong
        return math.inf


def order_lanes(thread: int, threads: int, count: int) -> tuple[Lane, ...]:
    """The queues to try, in order, for job number `count` of consumer thread `thread` of `threads`."""
    if thread == 0 and threads > 1:
        return ("small",)
    return ("large", "small") if count % LARGE_FIRST_EVERY == LARGE_FIRST_EVERY - 1 else ("small", "large")
