"""Reads TIFF stacks: each page is a view, and the views follow row by row.

The grid is `layout.pixels`. If that isn't given, it comes from the description of the first page, as
`{"shape": [V, U, ...]}` (tifffile and our own files), `frames=V` and `slices=U` (ImageJ), or `SizeT="V"` and
`SizeZ="U"` (OME). Without either, the pages fill a square.
"""

from __future__ import annotations

import io
import json
import re
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import tifffile

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import tiff
from ciir.renderer.readers.containers.axes import settle_grid
from ciir.renderer.readers.containers.samples import check_array, settle_depth_sense

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

_LONGEST_DESCRIPTION = 65_536
"""In characters; JSON in longer descriptions is not read."""


def is_stack(data: bytes) -> bool:
    """Returns whether a TIFF has more than one page, or its description states, as in our own files, that its page is
    the only view.

    Returns False if the file can't be opened; the reader of pictures reports that.
    """
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            first = file.pages.first
            described = _parse_description(first)
            one = {"grid": (1, 1), "size": (first.imagelength, first.imagewidth)}
            is_one_view = described.get("depth_sense") is not None and described.items() >= one.items()
            return len(file.pages) > 1 or is_one_view
    except MemoryError:
        raise
    except Exception:  # noqa: BLE001 - the library may raise any error
        return False


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the pages as views. Raises `InvalidOption` if they don't fill a grid."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        count = len(file.pages)
        if count > limits.views:
            raise TooLarge(f"{name}: {count:,} pages; at most {limits.views:,} views are read; give fewer", "views")
        described = _parse_description(file.pages.first)
        size = (file.pages.first.imagelength, file.pages.first.imagewidth)
        counted = described.get("grid", (0, 0))
        if layout.pixels is None and described.get("size") == size and counted[0] * counted[1] > count:
            raise Unreadable(
                f"{name}: damaged or cut off ({count} pages of the {counted[0]}x{counted[1]} views that its "
                "description counts); send the whole file, or give pixels ROWSxCOLUMNS of the views that are there"
            )
        grid, notes = settle_grid(count, layout, name, "pages", described.get("grid"))
        first, dtype = file.pages.first, np.dtype(file.pages.first.dtype)
        tiff.check_page(first, len(data), name, _allow)
        height, width, channels = first.imagelength, first.imagewidth, first.samplesperpixel
        check_array(name, (*grid, height, width, channels), dtype, limits)
        views = np.empty((count, height, width, channels), np.uint16 if dtype.kind == "f" else dtype.newbyteorder("="))
        for number, page in enumerate(cast("Iterator[tifffile.TiffPage]", file.pages)):
            if (page.shape, page.dtype) != (first.shape, first.dtype):
                raise Unreadable(f"{name}: page {number} is not like the first; make all views alike")
            tiff.check_page(page, len(data), name, _allow)
            views[number] = tiff.read_page(page, f"{name}: page {number}").reshape(height, width, channels)
    sense, guessed = settle_depth_sense(described.get("depth_sense"), layout)
    notes += guessed + tiff.note_page(first)
    return LightField(views.reshape(*grid, height, width, channels), notes, depth_sense=sense)


def _allow(height: int, width: int) -> None:
    """Accepts any size: it was checked together with that of all pages."""


def _parse_description(page: tifffile.TiffPage) -> dict[str, Any]:
    """Returns `grid`, `size` of a view and `depth_sense`, as far as the description of the first page has them."""
    text = page.description
    if text.startswith("{") and len(text) <= _LONGEST_DESCRIPTION:
        try:
            found = json.loads(text)
        except (ValueError, RecursionError):  # written by another program
            return {}
        shape = found.get("shape")
        if isinstance(shape, list) and page.axes == "SYX":  # one plane for each channel
            del shape[-3:-2]
        sizes = shape if isinstance(shape, list) and len(shape) in (4, 5) else []
        if len(sizes) > 1 and all(isinstance(size, int) and size > 0 for size in sizes[:2]):
            return {"grid": (sizes[0], sizes[1]), "size": tuple(sizes[2:4]), "depth_sense": found.get("depth_sense")}
    axes = {key: int(value) for key, value in re.findall(r'\bSize([TZ])="(\d{1,6})"', text[:_LONGEST_DESCRIPTION])}
    if "<OME" in text[:1000] and len(axes) == 2:
        return {"grid": (axes["T"], axes["Z"])}
    if text.startswith("ImageJ="):
        numbers = {key: int(value) for key, value in re.findall(r"^(frames|slices)=(\d{1,6})$", text, re.MULTILINE)}
        if len(numbers) == 2:
            return {"grid": (numbers["frames"], numbers["slices"])}
    return {}
