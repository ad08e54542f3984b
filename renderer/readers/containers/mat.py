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
_PIECE_BYTES = 2**16
"""Of packed bytes, unpacked at a time: memory of that size stays in the processor's cache."""
_TYPES = {"uint8": "u1", "uint16": "u2", "single": "f4", "double": "f8"}


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """The variable `LF`, or else the only one with five axes; no other variable is read."""
    if not data.startswith(VERSION_5):
        return hdf5.read(data, name=name, layout=layout, limits=limits)
    file = _unpack(data, name, limits)
    file.seek(0)
    listed = whosmat(file)
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
    file.seek(0)
    stored = loadmat(file, variable_names=[key])[key]
    if stored.dtype.kind not in "uif":
        raise Unreadable(f"{name}: {clean_text(key)} holds {stored.dtype}; give uint8, uint16, single or double")
    stored = stored.astype(_TYPES[kind], copy=False)  # whole doubles come as integers
    stored, weighted = hdf5.leave_out_weight(stored.reshape(shape))
    views, notes = convert_samples(stored, name)
    return LightField(views, weighted + notes, depth_sense="cameras")


def _unpack(data: bytes, name: str, limits: Limits) -> io.BytesIO:
    """The file with its variables as they are without zlib. Raises `TooLarge` before they take their memory."""
    order = "<" if data[_HEADER_BYTES - 2 : _HEADER_BYTES] == b"IM" else ">"
    elements = []
    start = _HEADER_BYTES
    while start + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, start)
        elements.append((kind, memoryview(data)[start : start + 8 + size]))
        start += 8 + size
    if all(kind != _COMPRESSED for kind, _ in elements):
        return io.BytesIO(data)
    allowed = left = min(limits.bytes, max(2**20, len(data) * limits.ratio))
    unpacked = io.BytesIO()
    unpacked.write(data[:_HEADER_BYTES])
    for kind, element in elements:
        if kind != _COMPRESSED:
            unpacked.write(element)
            continue
        stream = zlib.decompressobj()
        for place in range(8, len(element), _PIECE_BYTES):
            left -= unpacked.write(stream.decompress(element[place : place + _PIECE_BYTES], left + 1))
            if left < 0:
                raise TooLarge(f"{name}: unpacks to over {allowed:,} bytes; save it unpacked", "bytes")
    return unpacked
