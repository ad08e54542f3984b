"""Reads a set of pictures, one for each view, as a light field."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast, get_args

import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.renderer.readers.layout import DEPTH_SENSE_TEXT, Layout
from ciir.renderer.readers.metadata.colour_profiles import note_profile
from ciir.renderer.readers.names import clean_text, is_hidden
from ciir.renderer.readers.picture_sizes import START_BYTES, read_start
from ciir.renderer.readers.pictures import note_samples
from ciir.renderer.readers.registry import is_picture
from ciir.renderer.readers.view_set.grid import describe_unknown_shape, find_grids
from ciir.renderer.readers.view_set.order import (
    ASKED,
    add_note,
    correct,
    describe_other_axis,
    estimate,
    is_automatic,
    note_asked,
    reorient,
    unwind,
)
from ciir.renderer.readers.view_set.view_files import Decoder, ViewFiles, check_sizes
from ciir.renderer.view_order.estimate import estimate_order
from ciir.renderer.views import DepthSense, center_view, parse_views

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.view_set.grid import Grid
    from ciir.renderer.views import View

SIDE_FILES = frozenset({
    "", ".cfg", ".csv", ".db", ".exr", ".h5", ".hdf5", ".html", ".ini", ".json", ".log", ".mat", ".md", ".npy", ".npz",
    ".pdf", ".pfm", ".ply", ".txt", ".url", ".xml", ".yaml", ".yml",
})  # fmt: skip
"""Suffixes of files among the views that are ignored: notes, calibration, depth, reports."""
OWN_NAME = re.compile(r"view_(\d+)_(\d+)\.png")
OWN_PLANE = re.compile(r"plane_\d{3,4}_[dz][-+.\de]+(mm)?\.png")
"""Names of the depth planes of a stack that we wrote."""
_FIRST: dict[str, Literal["row", "column"]] = {"rows": "row", "columns": "column"}
MAX_REPORT = 2**24
"""The most bytes of a report that is read."""


def read(
    files: Mapping[str, bytes],
    *,
    name: str,
    layout: Layout = Layout(),  # noqa: B008 - it is frozen
    limits: Limits = DEFAULT_LIMITS,
    views: str = "all",
) -> ViewFiles:
    """Reads the light field whose views are the pictures in `files` (path in the set to bytes).

    Their names give the grid (`view_set.grid.find_grids`), or `layout.pixels` its rows and columns if they don't. A
    note states what was taken as row and column. Hidden files and `SIDE_FILES` are ignored. One picture is a 1x1 light
    field. The depth sense is that of cameras, unless positions in the names, or the report next to views of our own,
    state otherwise. If nothing was asked for, views that are certainly in a wrong order are put right.

    `views`: those that will be asked for. Only what the order needs is decoded here.

    Raises `InvalidOption` if the grid of views is not full or `layout` doesn't fit the names, `UnsupportedType` for a
    file that is not a picture and for depth planes that we wrote, `Unreadable` if pictures are missing, corrupt or
    differ in size, channels or depth, and `TooLarge` over `limits`.
    """
    names = _picture_names(files, name)
    if len(names) > limits.views:
        raise TooLarge(f"{name}: {len(names):,} pictures; at most {limits.views:,} views are read; give fewer", "views")
    if all(OWN_PLANE.fullmatch(PurePosixPath(file).name) for file in names):
        raise UnsupportedType(
            f"{name}: holds depth planes that ciir made, not views; give the light field that they were made from"
        )
    grids = find_grids(names, name, shape=layout.pixels, first=_FIRST.get(layout.order))
    check_sizes(files, [file for row in grids[0].files for file in row], name)
    own = _read_own_depth_sense(files, names)
    is_own = own is not None and OWN_NAME.fullmatch(PurePosixPath(names[0]).name) is not None
    decoder = Decoder(files, name, limits)
    found = [_make_views(grid, decoder, views, own) for grid in grids]
    if len(grids) == 1 or (layout.pixels is not None and not is_automatic(layout)):
        grid, light_field = grids[0], found[0]
    else:
        grid, light_field = _select_by_pictures(grids, found, name, has_shape=layout.pixels is not None)
    settled = _note_shape(_settle_order(light_field, grid, layout, is_own=is_own), layout)
    notes = note_profile(files[settled.some], clean_text(settled.some))
    notes += note_samples(files[settled.some])
    return replace(settled, notes=(*settled.notes, *notes))


class SomeViews(NamedTuple):
    """Some views of a light field, as `ciir reconstruct` writes them."""

    field: LightField
    """The views one after another, `(1, N, H, W, C)`."""
    places: tuple[View, ...]
    """(v, u) of each in the light field."""
    grid: tuple[int, int] | None
    """Rows and columns of the light field; None if no report states them."""


def read_some(files: Mapping[str, bytes], *, name: str, limits: Limits = DEFAULT_LIMITS) -> SomeViews | None:
    """Reads views that we wrote (`view_VV_UU.png`, with a report next to them or a text in them) if they are not all of
    a light field's. Returns None for all others, which `read` may read.

    Raises `Unreadable` if pictures are corrupt or differ in size, channels or depth, and `TooLarge` over `limits`.
    """
    names = sorted((file for file in files if not is_side_file(file)), key=_sort_key)
    matches = [OWN_NAME.fullmatch(PurePosixPath(file).name) for file in names]
    places = tuple((int(match[1]), int(match[2])) for match in matches if match is not None)
    own = _read_own_depth_sense(files, names) if places else None
    if own is None or len(set(places)) < len(names):
        return None
    array = _read_report(files, names[0])
    counts = array.get("pixels_v"), array.get("pixels_u")
    grid = cast("tuple[int, int]", counts) if all(isinstance(count, int) for count in counts) else None
    if len(places) >= math.prod(grid or np.max(places, axis=0) + 1):
        return None
    views = ViewFiles(Decoder(files, name, limits), np.array([names], dtype=object), names[0], depth_sense=own)
    return SomeViews(views.load(), places, grid)


def _note_shape(views: ViewFiles, layout: Layout) -> ViewFiles:
    """Returns the views, with a note if their own order gives other rows and columns than were asked for."""
    if layout.pixels in (None, views.files.shape) or not is_automatic(layout):
        return views
    given, found = ("{}x{}".format(*shape) for shape in (layout.pixels, views.files.shape))
    note = f"pixels: {given} was asked for, but the pictures are in order as {found}; order given keeps {given}"
    return replace(views, notes=(*views.notes, note))


def _make_views(grid: Grid, decoder: Decoder, views: str, own: DepthSense | None) -> ViewFiles:
    wanted = _find_first(views, grid.shape)
    notes: tuple[str, ...] = ()
    if grid.left_out:
        more = f" and {len(grid.left_out) - 1} more" if len(grid.left_out) > 1 else ""
        notes = (f"{clean_text(grid.left_out[0])}{more} left out, as the names are unlike those of the views",)
    return ViewFiles(
        decoder,
        np.array(grid.files, dtype=object),
        grid.files[wanted[0]][wanted[1]],
        notes,
        depth_sense=own or grid.depth_sense,
    )


def _find_first(views: str, shape: tuple[int, int]) -> View:
    """Returns the first of the wanted views, or the centre one if they aren't in a grid of `shape`."""
    try:
        return center_view(*shape) if views == "all" else parse_views(views, *shape)[0]
    except InvalidOption:  # the grid may be transposed
        return center_view(*shape)


def _select_by_pictures(
    grids: Sequence[Grid], found: Sequence[ViewFiles], name: str, *, has_shape: bool
) -> tuple[Grid, ViewFiles]:
    """Returns the grid in which the pictures are a light field according to the most tiles, else the first if
    `has_shape`.

    Raises `InvalidOption` if they certainly are in no grid, or in one with `missing` views.
    """
    estimates = [estimate_order(light_field) for light_field in found]
    certain = [number for number, estimate in enumerate(estimates) if estimate.is_certain]
    if not certain:
        if has_shape:
            return grids[0], found[0]
        raise InvalidOption(describe_unknown_shape(name, sum(map(len, grids[0].files)), grids[0].left_out))
    best = max(certain, key=lambda number: estimates[number].votes)
    if grids[best].missing:
        side, missing = max(grids[best].shape), grids[best].missing
        raise InvalidOption(
            f"{name}: the pictures are in order as {side}x{side} views, of which {missing} "
            f"{'is' if missing == 1 else 'are'} missing at the start or the end; give all of them, or remove the rest "
            "of that row"
        )
    return grids[best], found[best]


def _settle_order(views: ViewFiles, grid: Grid, layout: Layout, *, is_own: bool) -> ViewFiles:
    if layout.order == "serpentine":
        views = unwind(views)
    turned = reorient(views, layout)
    rows, cols = turned.files.shape
    change = "order rows" if layout.order == "columns" else "order columns"
    if layout.order == "serpentine":
        change = "no transpose" if layout.transpose else "transpose"
    naming = f"views: {rows}x{cols}, rows x columns: {grid.naming}{_describe_turns(layout.order == 'serpentine')}"
    row = f"; pixels 1x{rows * cols} takes them as one row" if grid.is_filled and layout.pixels is None else ""
    notes = (
        *views.notes,
        *([f"{naming}; {change} takes them the other way{row}"] if grid.naming and not is_own else []),
    )
    if layout.order in ASKED:
        return note_asked(replace(turned, notes=notes), layout)
    found = estimate(views, layout)
    if not (found.is_wrong and is_automatic(layout)):
        return add_note(replace(turned, notes=notes), found, layout)
    views = correct(turned, found)
    upwards = ", rows counted from the bottom up" if found.order.endswith("axis") else ""
    note = (
        f"order: {'x'.join(map(str, views.files.shape))} views, rows x columns: "
        f"{grid.transposed_naming if found.order.startswith('transposed') else grid.naming}"
        f"{_describe_turns(found.is_serpentine)}{upwards}, which fits {found.votes} of {found.of} "
        f"textured tiles{describe_other_axis(found)}; order given keeps the order of the "
        f"names{row}"
    )
    return replace(views, notes=(*views.notes, note), is_ordered=True)


def _describe_turns(is_serpentine: bool) -> str:
    return ", every other line of them reversed" if is_serpentine else ""


def is_side_file(file: str) -> bool:
    """Returns whether a file among the views is ignored."""
    return is_hidden(file) or PurePosixPath(file).suffix.lower() in SIDE_FILES


def _picture_names(files: Mapping[str, bytes], name: str) -> list[str]:
    """Returns the files that are pictures, in natural order."""
    names = []
    for file in files:
        if is_side_file(file):
            continue
        if not is_picture(file):
            raise UnsupportedType(f"{name}: {clean_text(file)} is not a picture that is read; convert it or remove it")
        names.append(file)
    if not names:
        raise Unreadable(f"{name}: holds no pictures; give a set of views as .png, .jpg or .tif files")
    return sorted(names, key=_sort_key)


def _sort_key(file: str) -> list[tuple[int, str]]:
    """Returns numbers by value, the rest by letter: `view_2` before `view_10`."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d{1,18})", file.lower())]


def _read_own_depth_sense(files: Mapping[str, bytes], names: Sequence[str]) -> DepthSense | None:
    """Returns the depth sense of views that we wrote, from the report next to them or from the first of them; None if
    neither states it.
    """
    from ciir.renderer.readers.png import find_text  # it imports Pillow

    stated = _read_report(files, names[0]).get("depth_sense")
    stated = stated or find_text(read_start(files, names[0], START_BYTES) or b"", DEPTH_SENSE_TEXT)
    return cast("DepthSense", stated) if stated in get_args(DepthSense) else None


def _read_report(files: Mapping[str, bytes], view: str) -> dict[str, Any]:
    """Returns `lens_array` of the report next to a view that we wrote; empty if there is none."""
    path = PurePosixPath(view)
    report = str(path.parent / "report.json")
    if OWN_NAME.fullmatch(path.name) is None or report not in files or len(data := files[report]) > MAX_REPORT:
        return {}
    try:
        return dict(json.loads(data)["lens_array"])
    except (LookupError, TypeError, ValueError, RecursionError):  # a report from another program
        return {}
