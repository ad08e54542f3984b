"""Reads light fields in HDF5: the old HCI data set, MATLAB 7.3, and the samples of BasicLFSR.

- HCI: `LF[v, U-1-u, y, x, c]`, cameras counted from the right, with `dH` and others as attributes (Wanner, Meister &
  Goldluecke, Datasets and Benchmarks for Densely Sampled 4D Light Fields, VMV 2013).
- MATLAB 7.3: `LF[c, x, y, u, v]`, because HDF5 counts axes from the other end, or cells: references to the views.
- BasicLFSR: `Hr_SAI_y[U*x, V*y]`, the transposed mosaic of the views' luminance (Generate_Data_for_Training.py).

Only plain data sets in the file itself are read: no links to other files, and no filters except deflate, LZF and
shuffle.
"""

from __future__ import annotations

import io
from itertools import islice
from typing import TYPE_CHECKING, Any

import h5py

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.containers.axes import settle_axes
from ciir.renderer.readers.containers.cells import Cell, CellArray, Views, find_views
from ciir.renderer.readers.containers.hdf5_data_set import DataSet, find_shape, holds_references, list_referenced
from ciir.renderer.readers.containers.samples import (
    LOGICAL,
    Header,
    check_array,
    convert_samples,
    find_light_field,
    holds_light_field,
    is_type_read,
    refuse_class,
)
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

HCI_ATTRIBUTE = "dH"
"""The distance between cameras; files of the old HCI data set have it."""
MOSAICS = ("Hr_SAI_y", "Lr_SAI_y")
MOSAIC_GRID = (5, 5)
"""The grid of BasicLFSR's samples if nothing else is known."""
WEIGHT = "the fourth channel of LF is a weight, not alpha: it is left out"
"""The note on a fourth channel."""
NEEDED = "a light field LF with five axes, or four if it is grey, at the top or up to two structs deep"
"""The required content of a MAT file of version 5, for messages."""
_NEEDED = "a light field LF with five axes, or four if it is grey, at the top or up to two groups deep"
LEVELS = 2
"""How many levels of groups, or of MATLAB structs, are searched for a light field."""
_CLASS = "MATLAB_class"
_MOST_NAMES = 1000
_LINKED = (0, 0, 0, 0, 0)
"""The shape of a light field whose own shape isn't known."""


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the light field `LF`, or else the only data set with five axes, or else a mosaic of BasicLFSR.

    If nothing has five axes, it reads the only data set with five in the file's groups, or else in the groups of those,
    or else the only MATLAB cell array that holds views, or else the only data set with four axes, also in groups.

    Raises `Unreadable` if there is none, and `UnsupportedType` if it is not stored in the file.
    """
    with h5py.File(io.BytesIO(data), "r") as file:
        shapes = {key: find_shape(file, key) for key in _list_names(file)}
        mosaic = next((key for key in MOSAICS if len(shapes.get(key, ())) == 2), None)
        if mosaic is not None and "LF" not in shapes:
            return _read_mosaic(DataSet.open(file, mosaic, data, name), layout, limits)
        found: Sequence[str] = list(shapes)
        for _ in range(LEVELS):
            if not holds_light_field(shapes):
                found_in_groups = _find_shapes_in_groups(file, found)
                shapes, found = shapes | found_in_groups, list(found_in_groups)
        searched = {"LF": shapes.get("LF", ())} if holds_light_field(shapes) else shapes
        arrays = _list_cell_arrays(file, searched, data)
        views, reason = find_views(arrays)
        shapes |= {key: array.shape for key, array in arrays.items()}
        key = find_light_field(shapes | {key: inner.shape for key, inner in views.items()}, name, _NEEDED, reason)
        if key in views:
            return _read_cells(DataSet.open(file, key, data, name), views[key], layout, limits)
        stored = DataSet.open(file, key, data, name)
        is_hci, shape = HCI_ATTRIBUTE in file.attrs, stored.shape
        # Views have more pixels than there are views: in `[c, x, y, u, v]` x comes before u. MATLAB omits a c of 1.
        is_reversed = len(shape) == 5 and 1 < shape[0] <= 4 and shape[1] > shape[3]
        is_matlab = _CLASS in stored.handle.attrs or is_reversed
        if is_matlab and not is_hci:
            return _read_matlab(stored, layout, limits)
        return _read_plain(stored, layout, limits, is_hci)


def _list_names(file: h5py.File) -> list[str]:
    """Returns the names of what the file holds, those of MATLAB's own groups, such as `#refs#`, last."""
    return sorted(islice(file, _MOST_NAMES), key=lambda name: name.startswith("#"))


def _list_cell_arrays(file: h5py.File, shapes: Mapping[str, tuple[int, ...]], data: bytes) -> dict[str, CellArray]:
    """Returns MATLAB's cell arrays among the data sets of these `shapes`, except those within cells."""
    arrays = {}
    for key, shape in shapes.items():
        is_array = len(shape) == 2 and not key.startswith("#")
        if is_array and holds_references(found := file[key]) and _find_class(found) == "cell":
            arrays[key] = CellArray(shape[::-1], map(_describe_cell, list_referenced(found, data)))
    return arrays


def _describe_cell(found: h5py.Dataset | None) -> Cell:
    shape = () if found is None else tuple(found.shape or ())
    if found is None or len(shape) < 2:  # an empty array is stored as one axis of its sizes
        return Cell("" if found is None else "empty", (0,))
    return Cell(_find_class(found), shape[::-1], found.dtype)


def _find_shapes_in_groups(file: h5py.File, keys: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of what lies in those `keys` that are groups of the file itself, as `GROUP/NAME`."""
    plain = (key for key in keys if not key.startswith("#"))  # not MATLAB's #refs#, to which its cells refer
    groups = [key for key in plain if isinstance(file.get(key, getlink=True), h5py.HardLink)]
    inner = (f"{key}/{name}" for key in groups if isinstance(file[key], h5py.Group) for name in file[key])
    return {key: find_shape(file, key) for key in islice(inner, _MOST_NAMES)}


def list_headers(data: bytes) -> dict[str, Header | None]:
    """Returns the headers of the arrays of numbers in a file, and None for groups. MATLAB's axes are put in order. If
    the file has a light field, only the shapes are filled in.
    """
    with h5py.File(io.BytesIO(data), "r") as file:
        names = list(islice(file, _MOST_NAMES))
        shapes = {key: _LINKED if _is_light_field(file, key) else find_shape(file, key) for key in names}
        if holds_light_field(shapes):
            return {key: Header(shape, 0) for key, shape in shapes.items()}
        plain = [key for key in names if isinstance(file.get(key, getlink=True), h5py.HardLink)]
        groups = {key for key in plain if isinstance(file[key], h5py.Group)}
        sets = {key: _describe_data_set(file[key], _is_matlab(data)) for key in plain if shapes[key]}
        return {key: sets.get(key) for key in plain if key in groups or sets.get(key) is not None}


def list_inner_shapes(data: bytes) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of what lies in the groups of a file and in their groups, and the axes of views in cells."""
    with h5py.File(io.BytesIO(data), "r") as file:
        shapes: dict[str, tuple[int, ...]] = {}
        top = found = _list_names(file)
        for _ in range(LEVELS):
            inner = _find_shapes_in_groups(file, found)
            shapes, found = shapes | inner, list(inner)
        views, _ = find_views(_list_cell_arrays(file, {key: find_shape(file, key) for key in top} | shapes, data))
        return shapes | {key: inner.shape for key, inner in views.items() if inner.cell.is_read}


def read_array(data: bytes, key: str, name: str) -> NDArray[Any]:
    """Reads the data set `key`, with MATLAB's axes put in order; `name` is for messages."""
    with h5py.File(io.BytesIO(data), "r") as file:
        stored = DataSet.open(file, key, data, name)
        _refuse_class(stored.handle, name)
        samples = stored.read()
        return samples.T if _find_class(stored.handle) or _is_matlab(data) else samples


def _is_light_field(file: h5py.File, key: str) -> bool:
    """Returns whether it is a mosaic of BasicLFSR, or an `LF` in another file, which must not be replaced by something
    else from this file.
    """
    link = file.get(key, getlink=True)
    return key in MOSAICS or (key == "LF" and isinstance(link, h5py.ExternalLink))


def _describe_data_set(found: h5py.Dataset, is_matlab: bool) -> Header | None:
    """Returns the header of a data set, or None for text, tables, and references such as those of cells."""
    try:
        dtype = found.dtype
    except (TypeError, ValueError):  # NumPy has no type for the data, such as HDF5's times
        return None
    kind = _find_class(found)
    if dtype.kind not in "iufbc" or kind in ("char", "cell"):
        return None
    shape = tuple(found.shape or ())
    return Header(shape[::-1] if kind or is_matlab else shape, found.nbytes, is_type_read(dtype) and kind != LOGICAL)


def _is_matlab(data: bytes) -> bool:
    return data.startswith(b"MATLAB")


def _find_class(found: h5py.Dataset) -> str:
    """Returns MATLAB's name of its class; empty for data from other programs."""
    kind = found.attrs.get(_CLASS, b"")
    return kind.decode("latin-1") if isinstance(kind, bytes) else ""


def _refuse_class(found: h5py.Dataset, name: str) -> None:
    """Raises `UnsupportedType` for data of a class of MATLAB that isn't read. `name` ends with that of the variable."""
    is_complex = found.dtype.names == ("real", "imag")
    refuse_class(f"complex {_find_class(found)}" if is_complex else _find_class(found), name)


def leave_out_weight(views: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Returns `(V, U, H, W, C)` without the weight of the Light Field Toolbox, and a note if there is one."""
    return (views[..., :3], (WEIGHT,)) if views.shape[4] == 4 else (views, ())


def _read_matlab(stored: DataSet, layout: Layout, limits: Limits) -> LightField:
    _refuse_class(stored.handle, _name(stored))
    axes = settle_axes(stored.shape[::-1], layout, stored.name)
    check_array(stored.name, axes.shape, stored.dtype, limits, axes.advice)
    samples, weighted = leave_out_weight(axes.arrange(stored.read().T))
    views, notes = convert_samples(samples, stored.name)
    return LightField(views, axes.notes + weighted + notes, depth_sense="cameras")


def _read_cells(found: DataSet, views: Views, layout: Layout, limits: Limits) -> LightField:
    refuse_class(views.cell.kind, f"{_name(found)}{{1,1}}")
    key = f"a cell of {found.handle.name.lstrip('/')}"
    handles = (handle for handle in list_referenced(found.handle, found.data) if handle is not None)
    stored = (DataSet.check(handle, key, found.data, found.name) for handle in handles)
    samples, arranged = views.read((cell.read().T for cell in stored), name=found.name, layout=layout, limits=limits)
    samples, weighted = leave_out_weight(samples)
    converted, notes = convert_samples(samples, found.name)
    return LightField(converted, arranged + weighted + notes, depth_sense="cameras")


def _name(stored: DataSet) -> str:
    return f"{stored.name}: {clean_text(stored.handle.name.lstrip('/'))}"


def _read_plain(stored: DataSet, layout: Layout, limits: Limits, is_hci: bool) -> LightField:
    """Reads `LF[v, u, y, x, c]`, as h5py writes an array. In files of the old HCI data set u counts from the right."""
    axes = settle_axes(stored.shape, layout, stored.name)
    check_array(stored.name, axes.shape, stored.dtype, limits, axes.advice)
    views, notes = convert_samples(axes.arrange(stored.read()), stored.name)
    return LightField(views[:, ::-1] if is_hci else views, axes.notes + notes, depth_sense="cameras")


def _read_mosaic(stored: DataSet, layout: Layout, limits: Limits) -> LightField:
    rows, columns = layout.pixels or MOSAIC_GRID
    width, height = stored.shape
    if height % rows or width % columns:
        raise InvalidOption(
            f"pixels: {rows}x{columns} views don't divide the mosaic of {height}x{width} pixels in {stored.name}; "
            "give rows and columns of views"
        )
    shape = (rows, columns, height // rows, width // columns, 1)
    check_array(stored.name, shape, stored.dtype, limits)
    mosaic = stored.read().T  # (V*H, U*W)
    views = mosaic.reshape(rows, shape[2], columns, shape[3], 1).transpose(0, 2, 1, 3, 4)
    views, notes = convert_samples(views, stored.name)
    guessed = "" if layout.pixels else f", of {rows}x{columns} views, as BasicLFSR's are; pixels gives another grid"
    notes += (f"{stored.handle.name.lstrip('/')}: a mosaic of luminance (16 to 235 of 255){guessed}",)
    return LightField(views, notes, depth_sense="cameras")
