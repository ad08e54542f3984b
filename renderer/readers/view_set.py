"""Reads a set of pictures, one for each view, as a light field."""

from __future__ import annotations

import math
import os
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.renderer.readers import pictures
from ciir.renderer.readers.names import clean_text, is_hidden
from ciir.renderer.readers.registry import is_picture

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ciir.renderer.readers.pictures import Pixels

SIDE_FILES = frozenset({
    "", ".cfg", ".csv", ".db", ".html", ".ini", ".json", ".log", ".mat", ".md", ".npy", ".npz", ".pdf", ".pfm", ".ply",
    ".txt", ".url", ".xml", ".yaml", ".yml",
})  # fmt: skip
"""Suffixes of files beside the views that are ignored: notes, calibration, depth, reports."""

# out_RR_CC_Y_X; focal length and sensor size may follow
STANFORD = re.compile(r"out_(\d{1,9})_(\d{1,9})(?:_-?[\d.]+)*_?")
# view_VV_UU, View_v_u, NAME_01_01, scene_u_v (whose u counts rows)
ROW_COLUMN = re.compile(r"(?:.*[^0-9a-z])?(\d{1,9})_(\d{1,9})")
# row-major, a square count
HCI = re.compile(r"input_cam(\d{1,9})")


def read(
    files: Mapping[str, bytes], *, name: str, grid: tuple[int, int] | None, limits: Limits = DEFAULT_LIMITS
) -> LightField:
    """The light field whose views are the pictures in `files` (path in the set to bytes).

    A file's name holds the view's row v and column u: `view_VV_UU` (ours), `out_RR_CC_Y_X` (Stanford), `input_CamNNN`
    (HCI, row-major), or anything that ends with `_R_C`. Both are counted from 0 or 1; a set that starts later is taken
    as a part of a larger one, with a note. Without such names the pictures fill `grid` = (pixels_v, pixels_u), or a
    square, row by row in natural order. Hidden files and `SIDE_FILES` are ignored. One picture is a 1x1 light field.

    Views keep the order of their names; Stanford's and HCI's have the depth sense of cameras.

    Raises `InvalidOption` where the grid of views is not full or `grid` doesn't fit the names, `UnsupportedType` for a
    file that is not a picture, `Unreadable` where pictures are missing, corrupt or differ in size, channels or depth,
    `TooLarge` over `limits`.
    """
    names = _picture_names(files, name)
    if len(names) > limits.views:
        raise TooLarge(f"{name}: {len(names):,} pictures; at most {limits.views:,} views are read; give fewer", "views")
    order, (pixels_v, pixels_u) = _arrange(names, name, grid)
    first = pictures.decode(files[order[0]], name=clean_text(order[0]), max_pixels=limits.pixels)
    if len(order) * first.nbytes > limits.set_bytes:
        raise TooLarge(
            f"{name}: {len(order)} views of {_describe(first)} come to {len(order) * first.nbytes:,} bytes; "
            f"at most {limits.set_bytes:,} are read; give fewer views or smaller ones",
            "set_bytes",
        )
    views = np.empty((len(order), *first.shape), first.dtype)
    views[0] = first

    def fill(index: int) -> None:
        picture = pictures.decode(files[order[index]], name=clean_text(order[index]), max_pixels=limits.pixels)
        if picture.shape != first.shape or picture.dtype != first.dtype:
            raise Unreadable(
                f"{name}: {clean_text(order[index])} is {_describe(picture)} but {clean_text(order[0])} is "
                f"{_describe(first)}; make all views alike"
            )
        views[index] = picture

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(max(2, cores)) as pool:
        try:
            for _ in pool.map(fill, range(1, len(order))):
                pass
        finally:
            pool.shutdown(cancel_futures=True)
    is_cameras = any(pattern.fullmatch(_stem(order[0])) for pattern in (STANFORD, HCI))
    return LightField(
        views.reshape(pixels_v, pixels_u, *first.shape),
        notes=_notes(order),
        depth_sense="cameras" if is_cameras else "lenses",
    )


def _notes(order: Sequence[str]) -> tuple[str, ...]:
    """A note where the names start after (1, 1): rows or columns before them may be missing."""
    match = next((m for pattern in (STANFORD, ROW_COLUMN) if (m := pattern.fullmatch(_stem(order[0])))), None)
    if match is None or len(order) == 1 or min(int(match[1]), int(match[2])) < 2:
        return ()
    place = int(match[1]), int(match[2])
    return (
        f"the views are named from {place}: they are taken as a part of a larger set, and counted from (0, 0) here",
    )


def _picture_names(files: Mapping[str, bytes], name: str) -> list[str]:
    """The files that are pictures, in natural order."""
    names = []
    for file in files:
        if is_hidden(file) or PurePosixPath(file).suffix.lower() in SIDE_FILES:
            continue
        if not is_picture(file):
            raise UnsupportedType(
                f"{name}: {clean_text(file)} is not a picture that is read; convert it or take it out"
            )
        names.append(file)
    if not names:
        raise Unreadable(f"{name}: no pictures in it; give a set of views as .png, .jpg or .tif files")
    return sorted(names, key=_sort_key)


def _sort_key(file: str) -> list[tuple[int, str]]:
    """Numbers by value, the rest by letter: `view_2` before `view_10`."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d{1,18})", file.lower())]


def _arrange(names: Sequence[str], name: str, grid: tuple[int, int] | None) -> tuple[list[str], tuple[int, int]]:
    """The files in row-major order of their views, and the grid that they fill."""
    if len(names) == 1 and grid in (None, (1, 1)):
        return list(names), (1, 1)
    for pattern in (STANFORD, ROW_COLUMN):
        places = _places(pattern, names, name)
        if places:
            return _full_grid(places, name, grid)
    _check_cameras(names, name)
    side = math.isqrt(len(names))
    if grid is None and side * side != len(names):
        raise InvalidOption(
            f"{name}: {len(names)} pictures without rows and columns in their names, and not a square number; "
            "give pixels ROWSxCOLUMNS (of views), or name them view_VV_UU.png"
        )
    grid = grid or (side, side)
    if grid[0] * grid[1] != len(names):
        raise InvalidOption(
            f"pixels: {grid[0]}x{grid[1]} asks for {grid[0] * grid[1]} views, but {name} holds {len(names)} pictures; "
            "give the rows and columns of the views that are there"
        )
    return list(names), grid


def _places(pattern: re.Pattern[str], names: Sequence[str], name: str) -> dict[tuple[int, int], str]:
    """The file at each (row, column) by its name; empty where no name fits the pattern."""
    places: dict[tuple[int, int], str] = {}
    others = []
    for file in names:
        match = pattern.fullmatch(_stem(file))
        if match is None:
            others.append(file)
            continue
        place = (int(match[1]), int(match[2]))
        if place in places:
            raise InvalidOption(
                f"{name}: {clean_text(places[place])} and {clean_text(file)} are both view {place}; "
                "take one of them out"
            )
        places[place] = file
    if places and others:
        raise InvalidOption(
            f"{name}: {clean_text(next(iter(places.values())))} is named by row and column, {clean_text(others[0])} is "
            "not; take it out of the set or rename it"
        )
    return places


def _full_grid(
    places: Mapping[tuple[int, int], str], name: str, grid: tuple[int, int] | None
) -> tuple[list[str], tuple[int, int]]:
    """The files row by row, and their grid: a full rectangle that starts at 0 or 1, or later in rows and in columns."""
    base = 0 if any(0 in place for place in places) else 1
    starts = [min(counts) for counts in zip(*places, strict=True)]
    first_row, first_column = starts if min(starts) > 1 else (base, base)
    last_row, last_column = (max(counts) for counts in zip(*places, strict=True))
    order = []
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if (row, column) not in places:
                raise InvalidOption(
                    f"{name}: {len(places)} pictures named from {min(places)} to {max(places)} "
                    f"(row, column), but no view {row, column}; add it, or rename them to a full grid from 0"
                )
            order.append(places[row, column])
    found = (last_row + 1 - first_row, last_column + 1 - first_column)
    if grid not in (None, found):
        raise InvalidOption(
            f"pixels: {grid[0]}x{grid[1]} is not the {found[0]}x{found[1]} grid of views in the names of {name}; "
            "leave the option out or rename the pictures"
        )
    return order, found


def _check_cameras(names: Sequence[str], name: str) -> None:
    """Checks that HCI's cameras have no gaps and no other files among them, so that natural order is theirs."""
    numbers = [int(match[1]) if (match := HCI.fullmatch(_stem(file))) else -1 for file in names]
    if max(numbers) < 0:
        return
    base = min(1, *(number for number in numbers if number >= 0))
    for expected, (number, file) in enumerate(zip(numbers, names, strict=True), base):
        if number < 0:
            raise InvalidOption(
                f"{name}: {clean_text(file)} is not named input_CamNNN as the others are; take it out of the set"
            )
        if number != expected:
            raise InvalidOption(f"{name}: input_Cam{expected:03d} is missing before {clean_text(file)}; add it")


def _stem(file: str) -> str:
    return PurePosixPath(file).stem.lower()


def _describe(picture: Pixels) -> str:
    height, width, channels = picture.shape
    return f"{height}x{width} pixels of {channels} x {8 * picture.itemsize} bit"
