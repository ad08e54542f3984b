"""Reads light fields from MATLAB files: `LF[j, i, l, k, c]`, as the Light Field Toolbox and BasicLFSR write it.

j and i count rows and columns of views, l and k those of pixels (Dansereau, Light Field Toolbox for Matlab; u grows to
the right, as with cameras). A fourth channel is the Toolbox's weight. MAT version 7.3 is HDF5. Version 5 is read here,
as MathWorks' "MAT-File Format" describes it, because SciPy's reader crashes the process on some invalid files.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.containers import hdf5
from ciir.renderer.readers.containers.axes import settle_axes
from ciir.renderer.readers.containers.cells import NO_SAMPLES, Cell, CellArray, find_views
from ciir.renderer.readers.containers.samples import (
    LOGICAL,
    Header,
    check_array,
    convert_samples,
    find_light_field,
    holds_light_field,
    refuse_class,
)
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

VERSION_5 = b"MATLAB 5.0 MAT-file"
_HEADER_BYTES, _MATRIX, _COMPRESSED = 128, 14, 15
_PIECE_BYTES = 2**16
"""How many packed bytes are unpacked at a time: a buffer of this size stays in the processor's cache."""
_START_BYTES = 2**12
"""The bytes at the start of a variable that contain its class, size and name, packed or not."""
_MOST_FIELDS = 1000
"""The most elements of a struct that are looked at."""
_CLASSES = (
    *("cell", "struct", "object", "char", "sparse", "double", "single"),
    *("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
)
"""Array classes, numbered from 1 (table 1-3)."""
_TYPES = {"uint8": "u1", "uint16": "u2", "single": "f4", "double": "f8"}
_SAME_NAME = "holds two variables of the same name; save each once"
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types of numbers in a file (table 1-1). They may be smaller than those of the array's class."""
_COMPLEX, _LOGICAL = 0x800, 0x200
"""Flags (table 1-2)."""


@dataclass(frozen=True)
class Variable:
    """An array as it is stored."""

    kind: str
    """Its class."""
    shape: tuple[int, ...]
    number: int = 0
    """The number of its samples' type, one of `_STORED` if it can be read."""
    samples: bytes | memoryview = b""
    """The samples, the first axis fastest."""
    matrix: bytes | memoryview = b""
    """The body of its element, which contains the cells."""

    def find_type(self, name: str) -> str:
        """Returns NumPy's name of its class. Raises `UnsupportedType` if that isn't read; `name` is for messages."""
        refuse_class(self.kind, name, known=tuple(_TYPES))
        return _TYPES[self.kind]

    def read(self, order: str, name: str) -> NDArray[Any]:
        """Returns the samples, whose size must have been checked. `order` is their byte order."""
        if self.number not in _STORED:
            raise Unreadable(f"{name} has samples of type {self.number}, which doesn't exist; save it again")
        samples = np.frombuffer(self.samples, order + _STORED[self.number]).reshape(self.shape, order="F")
        return samples.astype(self.find_type(name), copy=False)

    def list_cells(self, order: str) -> Iterator[Variable]:
        """Yields the contents of the cells of a cell array."""
        for kind, cell in islice(_split(memoryview(self.matrix), order), 3, 3 + math.prod(self.shape)):
            inner = _read_variable(cell, order) if kind == _MATRIX and cell else ()
            yield next((variable for _, variable in inner), _NO_ARRAY)

    def describe_cells(self, order: str) -> CellArray:
        """Returns the variable as an array whose cells may be views."""
        types = {kind: np.dtype(type_) for kind, type_ in _TYPES.items()}
        listed = (Cell(cell.kind, cell.shape, types.get(cell.kind, NO_SAMPLES)) for cell in self.list_cells(order))
        return CellArray(self.shape, listed)


_NO_ARRAY = Variable("", ())


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the variable `LF`, or else the only one with five axes. If there is none, it reads the only one in structs,
    or else the only cell array that holds views, or else the only variable with four axes, also in structs.
    """
    if not data.startswith(VERSION_5):
        return hdf5.read(data, name=name, layout=layout, limits=limits)
    order = _find_order(data)
    matrices = list(_unpack(data, order, name, limits))
    listed = [found for matrix in matrices for found in _read_variable(matrix, order)]
    variables = dict(listed)
    if len(variables) < len(listed):
        raise Unreadable(f"{name}: {_SAME_NAME}")
    shapes = {key: variable.shape for key, variable in variables.items()}
    for levels in range(1, hdf5.LEVELS + 1):
        if not holds_light_field(shapes):
            variables |= {key: found for matrix in matrices for key, found in _read_fields(matrix, order, levels)}
            shapes = {key: variable.shape for key, variable in variables.items()}
    is_found = holds_light_field(shapes)
    searched = {key: found for key, found in variables.items() if key == "LF" or not is_found}
    in_cells, reason = find_views(_describe_cells(searched, order))
    key = find_light_field(shapes | {key: found.shape for key, found in in_cells.items()}, name, hdf5.NEEDED, reason)
    found, what = variables[key], f"{name}: {clean_text(key)}"
    if key in in_cells:
        next(found.list_cells(order)).find_type(f"{what}{{1,1}}")
        cells = (cell.read(order, what) for cell in found.list_cells(order))
        samples, arranged = in_cells[key].read(cells, name=name, layout=layout, limits=limits)
    else:
        type_ = found.find_type(what)
        axes = settle_axes(found.shape, layout, name)  # MATLAB drops the last axis of grey views
        check_array(name, axes.shape, type_, limits, axes.advice)
        samples, arranged = axes.arrange(found.read(order, what)), axes.notes
    samples, weighted = hdf5.leave_out_weight(samples)
    views, notes = convert_samples(samples, name)
    return LightField(views, arranged + weighted + notes, depth_sense="cameras")


def list_headers(data: bytes, name: str) -> dict[str, Header | None]:
    """Returns the headers of the arrays of numbers in a file of version 5, and None for structs and for cells that may
    be views.

    Nothing else is unpacked. Raises `Unreadable` if two variables have the same name.
    """
    order = _find_order(data)
    found: dict[str, Header | None] = {}
    for element in _split(memoryview(data)[_HEADER_BYTES:], order):
        for key, variable in _read_start(element, order):
            if key in found:
                raise Unreadable(f"{name}: {_SAME_NAME}")
            if _may_hold_light_field(variable, order):
                found[key] = None
            elif variable.kind not in ("cell", "object", "char", "sparse"):
                size = np.dtype(_TYPES.get(variable.kind, "u1")).itemsize
                found[key] = Header(variable.shape, math.prod(variable.shape) * size, variable.kind in _TYPES)
    return found


def list_inner_shapes(data: bytes, name: str, limits: Limits) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of the fields of structs, of structs within them, and of the views in cells. Nothing else is
    unpacked.
    """
    order = _find_order(data)
    found: dict[str, Variable] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    for matrix in _unpack(data, order, name, limits, is_inner=True):
        fields = dict(_read_fields(matrix, order, hdf5.LEVELS))
        shapes |= {key: field.shape for key, field in fields.items()}
        found |= dict(_read_variable(matrix, order)) | fields
    views, _ = find_views(_describe_cells(found, order))
    return shapes | {key: inner.shape for key, inner in views.items() if inner.cell.is_read}


def read_array(data: bytes, key: str, name: str, limits: Limits) -> NDArray[Any]:
    """Reads the variable `key` of a file of version 5; `name` is for messages."""
    order = _find_order(data)
    for matrix in _unpack(data, order, name, limits):
        for other, variable in _read_variable(matrix, order):
            if other == key:
                variable.find_type(name)
                return variable.read(order, name)
    raise KeyError(key)


def _describe_cells(variables: Mapping[str, Variable], order: str) -> dict[str, CellArray]:
    return {key: found.describe_cells(order) for key, found in variables.items() if found.kind == "cell"}


def _may_hold_light_field(variable: Variable, order: str) -> bool:
    """Returns whether it is a struct, or has cells that may be views, judging by the start of its element."""
    return variable.kind == "struct" or (variable.kind == "cell" and variable.describe_cells(order).may_hold_views)


def _find_order(data: bytes) -> str:
    return "<" if data[_HEADER_BYTES - 2 : _HEADER_BYTES] == b"IM" else ">"


def _read_start(element: tuple[int, memoryview], order: str) -> Iterator[tuple[str, Variable]]:
    """Yields what `_read_variable` does for an element of the file, of which only the start is unpacked: samples are
    missing.
    """
    kind, body = element
    if kind == _COMPRESSED:
        start = zlib.decompressobj().decompress(body[:_START_BYTES], _START_BYTES)
        kind, body = next(_split(memoryview(start), order), (0, body))
    if kind == _MATRIX:
        yield from _read_variable(body[:_START_BYTES], order)


def _unpack(data: bytes, order: str, name: str, limits: Limits, *, is_inner: bool = False) -> Iterator[memoryview]:
    """Yields the body of each variable's element. With `is_inner`, it skips those that can't contain a light field.

    Raises `TooLarge` before more than the limit is unpacked into memory.
    """
    allowed = left = min(limits.bytes, max(2**20, len(data) * limits.ratio))
    for kind, element in _split(memoryview(data)[_HEADER_BYTES:], order):
        starts = _read_start((kind, element), order) if is_inner else ()
        if is_inner and not any(_may_hold_light_field(variable, order) for _, variable in starts):
            continue
        if kind == _COMPRESSED:
            stream, unpacked = zlib.decompressobj(), bytearray()
            for place in range(0, len(element), _PIECE_BYTES):
                piece = stream.decompress(element[place : place + _PIECE_BYTES], left + 1)
                unpacked += piece
                left -= len(piece)
                if left < 0:
                    raise TooLarge(f"{name}: unpacks to over {allowed:,} bytes; save it unpacked", "bytes")
            yield from (inner for kind, inner in _split(memoryview(unpacked), order) if kind == _MATRIX)
        elif kind == _MATRIX:
            yield element


def _split(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yields the elements in `data`, each with the number of its type."""
    start = 0
    while start + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, start)
        if kind >> 16:  # up to four bytes, within the tag
            yield kind & 0xFFFF, data[start + 4 : start + 4 + (kind >> 16)]
            start += 8
        else:
            start += 8
            yield kind, data[start : start + size]
            start += size if kind == _COMPRESSED else size + -size % 8


def _read_variable(matrix: memoryview, order: str) -> Iterator[tuple[str, Variable]]:
    """Yields the variable's name and the variable; nothing if it has no axes, such as a function."""
    flags, sizes, key, *samples = islice(_split(matrix, order), 4)
    (number,) = struct.unpack_from(f"{order}I", flags[1])
    if 1 <= number & 0xFF <= len(_CLASSES):
        kind = LOGICAL if number & _LOGICAL else _CLASSES[(number & 0xFF) - 1]
        kind = f"complex {kind}" if number & _COMPLEX else kind
        shape = tuple(np.frombuffer(sizes[1], f"{order}i4").tolist())
        type_, stored = samples[0] if samples else (0, b"")
        yield bytes(key[1]).decode("latin-1"), Variable(kind, shape, type_, stored, matrix)


def _read_fields(matrix: memoryview, order: str, levels: int) -> Iterator[tuple[str, Variable]]:
    """Yields the fields of a struct, and those of structs in it up to `levels` deep, as `STRUCT.FIELD`. Yields nothing
    for any other variable, nor for an array of structs.
    """
    for key, variable in _read_variable(matrix, order):
        if variable.kind != "struct" or math.prod(variable.shape) != 1:
            return
        _, _, _, (_, size), (_, names), *fields = islice(_split(matrix, order), _MOST_FIELDS)
        (length,) = struct.unpack(f"{order}i", size)
        for number, (_, field) in enumerate(fields):
            if not field:  # an empty array, without a header
                continue
            name = bytes(names[number * length : (number + 1) * length]).split(b"\0")[0].decode("latin-1")
            inner = [*_read_variable(field, order), *(_read_fields(field, order, levels - 1) if levels > 1 else ())]
            yield from ((f"{key}.{name}{below}", found) for below, found in inner)
