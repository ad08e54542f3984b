"""Reads NumPy's npy and npz files, never with pickle.

- npy: an array `L[v, u, y, x, c]`, or `L[v, u, y, x]` of grey views. In our own files the depth sense follows it, as
  text without axes.
- npz: one array, under any name; or the output of `renderer.writers.archives.NpzWriter`: `views[n, y, x, c]` with
  `positions[n] = (v, u)` and the report.

The format is that of `numpy.lib.format`.
"""

from __future__ import annotations

import io
import json
import math
import struct
import warnings
import zipfile
import zlib
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.containers.axes import settle_axes
from ciir.renderer.readers.containers.samples import (
    Header,
    check_array,
    convert_samples,
    find_light_field,
    is_type_read,
    settle_depth_sense,
)
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

_MOST_HEADER = 20_000
"""In bytes; NumPy reads headers of up to 10,000."""
_LOCAL_HEADER = struct.Struct("<26xHH")
"""The end of a zip member's local header: the lengths of its name and of whatever else precedes its content."""
VIEWS, POSITIONS, REPORT = "views", "positions", "report"


class Array:
    """An array in a file: its header, and its samples on demand, without a copy."""

    def __init__(self, data: bytes | memoryview, name: str) -> None:
        file = io.BytesIO(data[:_MOST_HEADER])
        version = np.lib.format.read_magic(file)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
        if read is None:
            raise UnsupportedType(f"{name}: version {version[0]}.{version[1]} of npy is not read; save it with NumPy")
        with warnings.catch_warnings():  # about headers that Python 2 wrote
            warnings.simplefilter("ignore", UserWarning)
            shape, self._is_fortran, self.dtype = read(file)
        self.shape: tuple[int, ...] = tuple(map(int, shape))
        self.is_grey = len(self.shape) == 4 and self.shape[3] > 4  # views without an axis of channels
        if self.is_grey:
            self.shape += (1,)
        self._data, self._start, self._name = data, file.tell(), name
        if self.dtype.hasobject:
            raise UnsupportedType(f"{name}: holds Python objects (pickle), which are never read; save numbers")

    @property
    def end(self) -> int:
        """The number of bytes from the start of the header to the end of the samples."""
        return self._start + math.prod(self.shape) * self.dtype.itemsize

    def read(self) -> NDArray[Any]:
        """Returns the array. It shares memory with the file's bytes and is read-only."""
        if len(self._data) < self.end:
            raise Unreadable(f"{self._name}: the array's samples are cut off; give the whole file")
        flat = np.frombuffer(self._data, self.dtype, math.prod(self.shape), self._start)
        return flat.reshape(self.shape[::-1]).T if self._is_fortran else flat.reshape(self.shape)

    @property
    def header(self) -> Header:
        """The description that precedes the samples."""
        return Header(self.shape, math.prod(self.shape) * self.dtype.itemsize, is_type_read(self.dtype))

    def read_text(self) -> str | None:
        """Returns the text of an array without axes, or None if it is another array."""
        return str(self.read()) if self.shape == () and self.dtype.kind == "U" else None


def read_npy(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the array as it is, `views[v, u, y, x, c]`, with the depth sense that follows it, else that of cameras,
    with a note.
    """
    array, stated = Array(data, name), None
    if data[array.end :].startswith(np.lib.format.MAGIC_PREFIX):
        stated = Array(memoryview(data)[array.end :], name).read_text()
    return _read_array(array, stated, name, layout, limits)


def _read_array(array: Array, stated: object, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads five axes as they are. Views one after another, in four axes or in three of grey views, become a grid."""
    axes = settle_axes(array.shape[:4] if array.is_grey else array.shape, layout, name)
    check_array(name, axes.shape, array.dtype, limits, axes.advice)
    made = _make_light_field(axes.arrange(array.read()), stated, name, layout)
    return replace(made, notes=axes.notes + made.notes)


def _make_light_field(views: NDArray[Any], stated: object, name: str, layout: Layout) -> LightField:
    made, notes = convert_samples(views, name)
    sense, guessed = settle_depth_sense(stated, layout)
    return LightField(made, notes + guessed, depth_sense=sense)


def read_npz(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the array `LF`, or the only one, or the one with five axes, or with four, or the views at their positions.

    The depth sense is the one that the report states, else that of cameras, with a note.
    """
    with _open_npz(data, name, limits) as (archive, members):
        arrays = {
            key: Array(_read_member(archive, member, data, name), f"{name}: {clean_text(key)}")
            for key, member in members.items()
        }
    shapes = {key: array.shape[:4] if array.is_grey else array.shape for key, array in arrays.items()}
    if 5 not in map(len, shapes.values()):
        shapes = {key: array.shape for key, array in arrays.items()}
    if VIEWS in arrays and POSITIONS in arrays and 5 not in map(len, shapes.values()):
        return _read_views(arrays, name, layout, limits)
    is_one = len(shapes) == 1
    key = (
        next(iter(shapes))
        if is_one
        else find_light_field(shapes, name, "a light field LF with five axes, (V, U, H, W, C), or four if it is grey")
    )
    return _read_array(arrays[key], None, f"{name}: {clean_text(key)}", layout, limits)


def list_headers(data: bytes, name: str, limits: Limits) -> dict[str, Header]:
    """Returns the headers of all arrays of an npz except texts. Packed arrays are not unpacked further."""
    with _open_npz(data, name, limits) as (archive, members):
        starts = {key: archive.open(member).read(_MOST_HEADER) for key, member in members.items()}
    found = {key: Array(start, f"{name}: {clean_text(key)}") for key, start in starts.items()}
    return {key: array.header for key, array in found.items() if array.dtype.kind not in "US"}


def read_array(data: bytes, key: str, name: str, limits: Limits) -> NDArray[Any]:
    """Reads the array `key` of an npz; `name` is for messages."""
    with _open_npz(data, name, limits) as (archive, members):
        return Array(_read_member(archive, members[key], data, name), name).read()


@contextmanager
def _open_npz(data: bytes, name: str, limits: Limits) -> Iterator[tuple[zipfile.ZipFile, dict[str, zipfile.ZipInfo]]]:
    """Opens the zip, and yields it with those of its members that are arrays, by the arrays' names."""
    from ciir.renderer.readers.bundle import check_members, check_sum

    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = check_members(name, archive.infolist(), limits)
        check_sum(name, members.values(), limits)
        yield archive, {key.removesuffix(".npy"): member for key, member in members.items() if _is_npy(key)}


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, data: bytes, name: str) -> bytes | memoryview:
    """Returns the content of a member of the zip `data`, without a copy if it is stored uncompressed."""
    if member.compress_type != zipfile.ZIP_STORED:
        return archive.read(member)
    start = member.header_offset + sum(_LOCAL_HEADER.unpack_from(data, member.header_offset), _LOCAL_HEADER.size)
    content = memoryview(data)[start : start + member.file_size]
    if zlib.crc32(content) != member.CRC:
        raise Unreadable(f"{name}: damaged (the checksum of {clean_text(member.filename)} is wrong); give it again")
    return content


def _is_npy(key: str) -> bool:
    return key.endswith(".npy") and "/" not in key


def _read_views(arrays: Mapping[str, Array], name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the views of our own npz, each at its position; all positions of a grid from (0, 0) must be present."""
    views, positions = arrays[VIEWS], arrays[POSITIONS]
    count = views.shape[0] if len(views.shape) == 4 else 0
    if count < 1 or positions.shape != (count, 2) or positions.dtype.kind not in "iu":
        raise Unreadable(f"{name}: views and positions don't fit each other; give the npz as it was written")
    places = positions.read()
    rows, columns = (int(most) + 1 for most in places.max(axis=0))
    if rows * columns != count or places.min() < 0:
        raise Unreadable(
            f"{name}: {count} views, up to ({rows - 1}, {columns - 1}), fill no grid; write it with views all"
        )
    check_array(name, (rows, columns, *views.shape[1:]), views.dtype, limits)
    order = np.full(count, -1)
    order[places[:, 0].astype(np.int64) * columns + places[:, 1]] = np.arange(count)
    if (order < 0).any():
        raise Unreadable(f"{name}: a position occurs twice; give the npz as it was written")
    stored = views.read()
    if not np.array_equal(order, np.arange(count)):
        stored = stored[order]
    return _make_light_field(stored.reshape(rows, columns, *views.shape[1:]), _find_depth_sense(arrays), name, layout)


def _find_depth_sense(arrays: Mapping[str, Array]) -> object:
    """Returns what the report states, or None if there is no report."""
    text = arrays[REPORT].read_text() if REPORT in arrays else None
    if text is None:
        return None
    try:
        return json.loads(text)["lens_array"]["depth_sense"]
    except (LookupError, TypeError, ValueError, RecursionError):  # a report from another program
        return None
