"""Two queues, so that small jobs never wait behind large ones."""

from __future__ import annotations

import io
import math
import os
import zipfile
from dataclasses import replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, cast

from ciir.errors import InputError
from ciir.models import catalogue
from ciir.models.light_field.fusion.views import BLOCK_SIDE, MOST_PIXELS, is_matched
from ciir.renderer.displays.pictures import find_kind, find_target
from ciir.renderer.readers import picture_sizes
from ciir.renderer.readers.bundle import PACKED
from ciir.renderer.readers.names import FRAMES, is_hidden
from ciir.renderer.readers.registry import ARRAYS, ZIP, find_by_signature, is_container, is_mesh, is_picture
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.renderer.writers.formats import VIDEOS
from ciir.service.pipeline.displays.rays import count_rays
from ciir.service.pipeline.job import LENSES, PIXELS
from ciir.service.pipeline.options import KINDS, MODELS, NO_MODEL

if TYPE_CHECKING:
    from ciir.models.catalogue import Entry
    from ciir.renderer.displays.pictures import Kind as DisplayKind
    from ciir.service.jobs.job import Lane, Request
    from ciir.service.pipeline.options import Options

LANES: tuple[Lane, ...] = ("small", "large")
SMALL_ESTIMATE = 2.0
"""Most seconds of a small job, as predicted by `estimate_seconds`."""
SMALL_SECONDS = 5.0
"""Seconds after which a job in the small lane that keeps others waiting is moved to the large one."""
LARGE_FIRST_EVERY = 4
"""A thread prefers the large queue for one job in this many, so that large jobs run while small ones keep coming."""
_READ, _DRAW, _SAMPLE = 4e-7, 1.6e-7, 2.5e-7
"""Typical seconds to read a byte, to draw a triangle with OpenGL, and to take a sample of a mesh."""
_DECODE, _RESAMPLE = 3e-8, 3e-7
"""Typical seconds for a pixel of a picture, and the additional time for a pixel of a raw lenslet picture."""
_MULTIPLY_ADD, _INT8_SHARE = 2e-11, 0.3
"""Typical seconds for a network's multiply-add in float, and the share of it in int8."""
_WRITE, _FRAME = 1e-7, 4e-7
"""Typical seconds for a pixel that is written, and for a pixel of a video's frame."""
_SHIFT, _MATCH, _MODEL, _FUSE = 1e-8, 2e-5, 1.5e-6, 2.5e-6
"""Typical seconds for a view's pixel in a depth plane, for a pixel of a disparity map, for a view's pixel in a model,
and for one of a view that is matched with those around it."""
_TRIANGLE_BYTES, _SAMPLES = 12, 3
"""Least bytes of a triangle in usual files: three indices of 4 bytes; and of a pixel in a file of arrays."""
_WINDOW = 25
"""Number of views that a light-field network takes for one."""
_DIRECTORY_BYTES = 1 << 20
"""Bytes at the end of a zip that are read for its directory: enough for 10,000 files, and read in 0.1 s."""
_HEAD_BYTES = 1 << 18
"""Bytes at the start of a picture that are read for its size."""


class Content(NamedTuple):
    """The size of an input."""

    size: float
    """Bytes, unpacked."""
    pixels: float | None = None
    """Of all its pictures; None for a file that may be a mesh."""
    view: float | None = None
    """Of each view; None if the file doesn't say what its views are."""


def choose_lane(request: Request, file: BinaryIO) -> Lane:
    """Returns `small` for a job of up to `SMALL_ESTIMATE` seconds, else `large`."""
    return "small" if estimate_job(request, file) <= SMALL_ESTIMATE else "large"


def estimate_job(request: Request, file: BinaryIO) -> float:
    """Estimates the seconds of a job on a typical machine; infinity if the start of `file` doesn't show its size."""
    return estimate_seconds(request, measure(file))


def estimate_seconds(request: Request, content: Content) -> float:
    """Estimates the seconds that `request` takes on a typical machine.

    Anything that only the rest of the file's content shows, such as instances, is not considered.
    """
    size, pixels, _ = content
    options = KINDS[request.kind].parse(request.options)
    if options.moments:
        single = {name: text for name, text in request.options.items() if name not in ("time", "rotate")}
        return len(options.moments) * estimate_seconds(replace(request, options=single, format=None), content)
    read = size * _READ if pixels is None else pixels * _DECODE
    if request.kind == "inspection":
        return read
    if request.kind == "upscale":
        return read + (pixels or 0) * options.scale**2 * _price_pixel(options.model, catalogue.FALLBACK)
    if request.kind == "display":
        larger = 0 if pixels is None or options.model == NO_MODEL else pixels * options.scale**2
        upscaled = larger * _price_pixel(options.model, catalogue.LIGHT_FIELD_DEFAULT)
        fused = pixels * _FUSE if pixels and _is_matched(options, _find_array(options, content)[0]) else 0
        return read + upscaled + fused + _count_rays(request, options) * _SAMPLE
    if request.kind == "elemental":
        options = replace(options, views="all", model=NO_MODEL)
    if request.kind in ("plane", "disparity"):
        options = replace(options, views="all")
    lenses, grid = _find_array(options, content)
    wanted = {"center": 1, "cross": 5, "all": grid}.get(options.views, options.views.count(";") + 1)
    larger = 1 if options.model == NO_MODEL else options.scale**2
    upscaled, fused = wanted, 0.0
    if pixels is not None and _is_matched(options, lenses):
        upscaled, fused = min(BLOCK_SIDE**2 * wanted, grid), lenses * wanted * _FUSE
    written = fused + lenses * upscaled * larger * _price_pixel(options.model, catalogue.LIGHT_FIELD_DEFAULT)
    if request.kind == "plane":
        written += lenses * larger * (_MATCH + grid * _SHIFT * (options.stack[2] if options.stack else 1))
    elif request.kind == "disparity":
        written += lenses * larger * (grid * _MODEL if request.format in MODELS else _MATCH)
    elif request.format in VIDEOS:
        written += lenses * larger * options.frames * _FRAME
    if pixels is not None:
        return read + (0 if options.lens_pitch is None else pixels * _RESAMPLE) + written
    rendered = wanted if options.model == NO_MODEL else min(_WINDOW * wanted, grid)
    samples = lenses * rendered * (LENSLET_SAMPLES if options.sampling == "lenslet" else 1) ** 2
    if options.strategy != "upscale":
        samples = max(samples, lenses * wanted * (LENSLET_SAMPLES * options.scale) ** 2)
    drawn = size / _TRIANGLE_BYTES * rendered if options.backend == "raster" else 0
    return read + drawn * _DRAW + samples * _SAMPLE + written


def _count_rays(request: Request, options: Options) -> int:
    """Counts rays of a display picture, or samples of views, which cost about as much; 0 if the display is refused."""
    try:
        return count_rays(find_target(cast("DisplayKind", request.format or find_kind(options)), options), options)
    except InputError:
        return 0


def _find_array(options: Options, content: Content) -> tuple[float, float]:
    """Returns the numbers of lenses (a view's pixels) and of views. For a picture, one follows from its pixels."""
    lenses, grid = math.prod(options.lenses or LENSES), math.prod(options.pixels or PIXELS)
    pixels = content.pixels
    if pixels is None:
        return lenses, grid
    if content.view:
        return content.view, pixels / content.view
    return (lenses, pixels / lenses) if options.lenses else (pixels / grid, grid)


def _price_pixel(model: str, default: str) -> float:
    """Returns the seconds for an output pixel with `model`; `auto` counts as `default`, or its int8 twin."""
    entry = _find_entry(model, default)
    if entry is None or entry.card is None:
        return _WRITE
    share = _INT8_SHARE if entry.card.precision == "int8" else 1.0
    return _WRITE + entry.card.macs_per_output_pixel * _MULTIPLY_ADD * share


def _is_matched(options: Options, lenses: float) -> bool:
    """Returns whether views of a light field may be matched with those around them, which are then upscaled too."""
    entry = _find_entry(options.model, catalogue.LIGHT_FIELD_DEFAULT)
    if entry is None or entry.card is None or not entry.is_light_field or options.fusion == "never":
        return False
    is_fused = options.fusion == "always" or lenses <= MOST_PIXELS
    return is_fused and is_matched(options.fusion, entry.card.macs_per_output_pixel)


def _find_entry(model: str, default: str) -> Entry | None:
    """Returns the entry of `model`, for `auto` that of `default` or its int8 twin; None for `none`."""
    entries = {entry.name: entry for entry in catalogue.list_entries()}
    return None if model == NO_MODEL else entries.get(model, entries[catalogue.prefer_int8(default)])


def measure(file: BinaryIO) -> Content:
    """Measures the content of `file` by its header, or by a zip's directory and the header of its first picture.

    Sizes are infinite for a zip without a readable directory, and for a picture whose start doesn't state its size.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    head = file.read(_HEAD_BYTES)
    if head.startswith(ZIP.signatures):
        try:
            return _measure_zip(file, size)
        except Exception:  # noqa: BLE001 - zipfile raises many kinds; the worker process reports what is wrong
            return Content(math.inf)
    if picture_sizes.find_format(head) is not None:
        return Content(size, _measure_picture(head))
    is_array = any(entry.name in ARRAYS for entry in find_by_signature(head))
    return Content(size, size / _SAMPLES if is_array else None)


def _measure_zip(file: BinaryIO, size: int) -> Content:
    file.seek(max(0, size - _DIRECTORY_BYTES))
    with zipfile.ZipFile(io.BytesIO(file.read())) as archive:
        members = archive.infolist()
    if any(member.compress_type not in PACKED for member in members):  # refused later; a small part of it may be huge
        return Content(math.inf)
    names = [member.filename for member in members if not is_hidden(member.filename)]
    unpacked = max(size, sum(member.file_size for member in members))
    pictures = [name for name in names if is_picture(name) and PurePosixPath(name).stem.lower() not in FRAMES]
    if any(is_mesh(name) for name in names):
        return Content(unpacked)
    if not pictures:
        return Content(unpacked, unpacked / _SAMPLES if any(is_container(name) for name in names) else None)
    with zipfile.ZipFile(file) as archive, archive.open(pictures[0]) as first:
        pixels = _measure_picture(first.read(_HEAD_BYTES))
    return Content(unpacked, len(pictures) * pixels, pixels if len(pictures) > 1 else None)


def _measure_picture(head: bytes) -> float:
    """Returns the pixels that the start of a picture states; infinity if it states none."""
    found = picture_sizes.find_format(head)
    size = None if found is None else picture_sizes.read_size(found, head)
    return math.inf if size is None else math.prod(size)


def order_lanes(thread: int, threads: int, count: int) -> tuple[Lane, ...]:
    """Returns the queues to try, in order, for job number `count` of consumer thread `thread` of `threads`."""
    if thread == 0 and threads > 1:
        return ("small",)
    return ("large", "small") if count % LARGE_FIRST_EVERY == LARGE_FIRST_EVERY - 1 else ("small", "large")
