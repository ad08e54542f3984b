"""Reads light fields of MATLAB: `LF[j, i, l, k, c]`, as the Light Field Toolbox and BasicLFSR write it.

j and i count rows and columns of views, l and k those of pixels (Dansereau, Light Field Toolbox for Matlab; u grows to
the right, as with cameras). A fourth channel is the Toolbox's weight. MAT version 7.3 is HDF5.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING

from scipy.io import loadmat, whosmat

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.containers import hdf5
from ciir.renderer.readers.containers.samples import check_array, convert_samples
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

VERSION_5 = b"MATLAB 5.0 MAT-file"
_HEADER_BYTES, _COMPRESSED = 128, 15
_TYPES = {"uint8": "u1", "uint16": "u2", "single": "f4", "double": "f8"}


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """The variable `LF`, or else the only one with five axes; no other variable is read."""
    if not data.startswith(VERSION_5):
        return hdf5.read(data, name=name, layout=layout, limits=limits)
    data = _unpack(data, name, limits)
    listed = whosmat(io.BytesIO(data))
    variables = {key: (tuple(map(int, shape)), kind) for key, shape, kind in listed}
    if len(variables) < len(listed):
        raise Unreadable(f"{name}: holds two variables of one name; save each once")
    key = hdf5.find_variable({key: shape for key, (shape, _) in variables.items()}, name)
    shape, kind = variables[key]
    if kind not in _TYPES:
        raise UnsupportedType(
            f"{name}: {clean_text(key)} is of class {clean_text(kind)}; give uint8, uint16, single or double"
        )
    shape = (*shape, 1)[:5]  # MATLAB drops the last axis of grey views
    check_array(name, shape, _TYPES[kind], limits)
    stored = loadmat(io.BytesIO(data), variable_names=[key])[key]
    if stored.dtype.kind not in "uif":
        raise Unreadable(f"{name}: {clean_text(key)} holds {stored.dtype}; give uint8, uint16, single or double")
    stored, weighted = hdf5.leave_out_weight(
        stored.astype(_TYPES[kind], copy=False).reshape(shape, order="F")
    )  # whole doubles come as integers
    views, notes = convert_samples(stored, name)
    return LightField(views, weighted + notes, depth_sense="cameras")


def _unpack(data: bytes, name: str, limits: Limits) -> bytes:
    """The file with its variables as they are without zlib. Raises `TooLarge` before they take their memory."""
    order = "<" if data[_HEADER_BYTES - 2 : _HEADER_BYTES] == b"IM" else ">"
    allowed = left = min(limits.bytes, max(2**20, len(data) * limits.ratio))
    elements: list[bytes | memoryview] = [memoryview(data)[:_HEADER_BYTES]]
    start = _HEADER_BYTES
    while start + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, start)
        element: bytes | memoryview = memoryview(data)[start : start + 8 + size]
        start += 8 + size
        if kind == _COMPRESSED:
            element = zlib.decompressobj().decompress(element[8:], left + 1)
            left -= len(element)
        if left < 0:
            raise TooLarge(f"{name}: unpacks to over {allowed:,} bytes; save it unpacked", "bytes")
        elements.append(element)
    return b"".join(elements) if left < allowed else data
