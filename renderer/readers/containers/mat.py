"""Reads light fields of MATLAB: `LF[j, i, l, k, c]`, as the Light Field Toolbox and BasicLFSR write it.

j and i count rows and columns of views, l and k those of pixels (Dansereau, Light Field Toolbox for Matlab; u grows to
the right, as with cameras). A fourth channel is the Toolbox's weight. MAT version 7.3 is HDF5.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from scipy.io import loadmat, whosmat

from ciir.errors import Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.containers import hdf5
from ciir.renderer.readers.containers.samples import check_array, convert_samples
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

VERSION_5 = b"MATLAB 5.0 MAT-file"
_TYPES = {"uint8": "u1", "uint16": "u2", "single": "f4", "double": "f8"}


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """The variable `LF`, or else the only one with five axes; no other variable is read."""
    if not data.startswith(VERSION_5):
        return hdf5.read(data, name=name, layout=layout, limits=limits)
    variables = {key: (tuple(map(int, shape)), kind) for key, shape, kind in whosmat(io.BytesIO(data))}
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
