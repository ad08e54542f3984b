"""Writes a stack of depth planes: pictures in a folder or a zip, a TIFF, arrays, or a video that moves through them.

Planes are made one after the other while they are written; none is kept.
"""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import dataclass
from functools import partial
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np

from ciir.renderer.levels import note_rounding, round_levels
from ciir.renderer.writers import pictures
from ciir.renderer.writers.archives import add_array
from ciir.renderer.writers.atomic_write import Staged
from ciir.renderer.writers.file_writer import make_writer
from ciir.renderer.writers.formats import FORMATS, VIDEOS, check_options
from ciir.renderer.writers.options import FormatOptions, WriterOptions
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import REPORT, ZIP_DATE, Contents, report_json

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from ciir.renderer.writers.containers.video import PathWriter

    Planes = Iterator[NDArray[np.float32]]
    WriteStack = Callable[[IO[bytes], "Stack"], list[str]]


KEPT = 2**28
"""Most bytes of frames that are kept."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Depth planes to write."""

    names: tuple[str, ...]
    """Name of each plane, as a file without a suffix."""
    kind: str
    """What `values` are: `disparities` or `depths`."""
    values: tuple[float, ...]
    shape: tuple[int, int, int]
    """`(H, W, C)` of a plane."""
    dtype: np.dtype[np.uint8] | np.dtype[np.uint16]
    """Data type of the views, in whose units planes are."""
    make: Callable[[Sequence[int]], Planes]
    """Function that makes planes by their numbers, in that order."""
    describe: Callable[[], dict[str, Any]]
    """Function that returns the report so far."""
    fps: float | None = None
    """Frames per second of a video, by default the writer's."""
    unused: int = 0
    """From `ciir.bit_depth.count_unused_camera_bits` of all views: a video raises planes by that many bits."""

    def __len__(self) -> int:
        return len(self.names)

    def read(self) -> Planes:
        """Yields all planes in their order."""
        return self.make(range(len(self)))


def check_rate(fps: float | None, name: str | None) -> None:
    """Raises `InvalidOption` if `fps` is given although the format `name`, or a folder (None), does not use it."""
    uses, what = ((), "a folder of pictures") if name is None else (FORMATS[name].uses, f"format {name}")
    check_options(FormatOptions(fps=fps), uses, what)


def write_pictures(stack: Stack, write: Callable[[str, bytes], object]) -> list[str]:
    """Passes `NAME.png` of each plane to `write`, and `report.json`; returns no notes."""
    for name, plane in zip(stack.names, stack.read(), strict=True):
        write(f"{name}.png", encode_png(round_levels(plane, stack.dtype)))
    write(REPORT, report_json(stack.describe()))
    return []


def write_folder(path: Path, stack: Stack) -> list[str]:
    """Writes a PNG of each plane and `report.json`; the planes that an earlier report there lists are removed."""
    staged, earlier = Staged(path), _list_earlier(path)
    try:
        write_pictures(stack, staged.write)
        stale = earlier - {f"{name}.png" for name in stack.names}
        staged.commit(remove=stale)
    finally:
        staged.discard()
    return [f"planes of an earlier run removed from the output folder: {len(stale)}"] if stale else []


def _list_earlier(folder: Path) -> set[str]:
    try:
        names = [f"{plane['name']}.png" for plane in json.loads((folder / REPORT).read_bytes())["planes"]]
    except (OSError, LookupError, TypeError, ValueError):  # none, or a report.json from another program
        return set()
    return {name for name in names if re.fullmatch(r"(plane_\d+_[dz][-+.\w]+|all_in_focus)\.png", name)}


def _write_zip(file: IO[bytes], stack: Stack) -> list[str]:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        return write_pictures(stack, lambda name, data: archive.writestr(zipfile.ZipInfo(name, ZIP_DATE), data))


def _write_picture(file: IO[bytes], stack: Stack, picture: pictures.PictureFormat) -> list[str]:
    (plane,) = stack.read()
    file.write(picture.encode(round_levels(plane, stack.dtype)))
    return []


def _write_tiff(file: IO[bytes], stack: Stack) -> list[str]:
    """Writes a page for each plane, whose name is its `PageName` (TIFF 6.0, tag 285)."""
    import tifffile

    from ciir.renderer.writers.pictures.tiff import describe_page

    height, width, channels = stack.shape
    size = len(stack) * height * width * channels * stack.dtype.itemsize
    handle = tifffile.FileHandle(file, name="stack.tif")  # a file opened from a descriptor has a number as name
    with tifffile.TiffWriter(handle, bigtiff=size > 2**31) as tiff:
        for name, plane in zip(stack.names, stack.read(), strict=True):
            picture = round_levels(plane, stack.dtype)
            tiff.write(
                picture if channels > 1 else picture[..., 0],
                **describe_page(channels),
                extratags=[(285, 2, 0, name, True)],
            )
    return []


def _write_npy(file: IO[bytes], stack: Stack) -> list[str]:
    """Writes `(n, H, W, C)` float32, in the units of the views, not rounded."""
    header = {"descr": "<f4", "fortran_order": False, "shape": (len(stack), *stack.shape)}
    np.lib.format.write_array_header_1_0(file, header)
    for plane in stack.read():
        file.write(np.ascontiguousarray(plane, "<f4").data)
    return []


def _write_npz(file: IO[bytes], stack: Stack) -> list[str]:
    """Writes `planes` as in an npy file, their `disparities` or `depths`, and `report` (JSON text)."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        with archive.open(zipfile.ZipInfo("planes.npy", ZIP_DATE), "w", force_zip64=True) as member:
            _write_npy(member, stack)
        report = report_json(stack.describe()).decode()
        add_array(archive, stack.kind, np.array(stack.values))
        add_array(archive, "report", np.array(report))
    return []


def _write_video(file: IO[bytes], stack: Stack, name: str) -> list[str]:
    """Writes frames of 8-bit RGB from the first plane to the last and back."""
    back = range(len(stack) - 2, 0, -1)
    options = WriterOptions(frames=len(stack) + len(back), fps=stack.fps)
    writer = cast("PathWriter", make_writer(FORMATS[name], file, options))
    height, width, channels = stack.shape
    writer.check(Contents(((0, 0),), (1, 1), height, width, channels, stack.dtype))
    notes = writer.write_frames(_list_frames(stack, back))
    return notes + note_rounding(name, stack.dtype, stack.unused)


def _list_frames(stack: Stack, back: range) -> Iterator[NDArray[np.uint8]]:
    """Yields all planes, and those of `back` again: from memory, or made again if all of them are too large to keep."""
    height, width, _ = stack.shape
    is_kept = len(stack) * height * width * 3 <= KEPT
    kept = {}
    for number, plane in enumerate(stack.make([*range(len(stack)), *(() if is_kept else back)])):
        frame = _to_rgb8(plane, stack)
        if is_kept:
            kept[number] = frame
        yield frame
    yield from (kept[number] for number in back if is_kept)


def _to_rgb8(plane: NDArray[np.float32], stack: Stack) -> NDArray[np.uint8]:
    """Converts to RGB: grey is repeated, alpha is ignored."""
    colours = plane[..., :3] if plane.shape[2] >= 3 else plane[..., :1].repeat(3, axis=2)
    scale = np.float32(255 / np.iinfo(stack.dtype).max * 2**stack.unused)
    levels: NDArray[np.uint8] = np.rint(colours * scale).clip(0, 255).astype(np.uint8)
    return levels


PLANE: dict[str, WriteStack] = {
    **{name: partial(_write_picture, picture=picture) for name, picture in pictures.FORMATS.items()},
    "npy": _write_npy,
    "npz": _write_npz,
}
"""Functions that write one plane, by names of `renderer.writers.formats.FORMATS`."""
STACK: dict[str, WriteStack] = {
    "zip": _write_zip,
    "stack": _write_tiff,
    "npy": _write_npy,
    "npz": _write_npz,
    **{name: partial(_write_video, name=name) for name in VIDEOS},
}
"""Functions that write several planes, by the same names."""
PLANE_BY_SUFFIX, STACK_BY_SUFFIX = (
    {suffix: name for name in writers for suffix in FORMATS[name].suffixes} for writers in (PLANE, STACK)
)
"""The name of the format for a file's suffix."""
