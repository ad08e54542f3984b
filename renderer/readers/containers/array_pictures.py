"""One picture as an array, `(H, W)` or `(H, W, C)`, in NPY, NPZ, MAT or HDF5: an elemental image array, or a mosaic.

It is the file's only array of that kind, or the only one of a picture's size, where nothing may hold a light field.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.containers import arrays
from ciir.renderer.readers.containers.samples import check_array, convert_samples

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.readers.containers.samples import Header
    from ciir.renderer.readers.pictures import Pixels

LEAST_SIDE = 16
"""Pixels: smaller arrays beside a picture are taken as others, such as the matrix of a camera."""
CHANNELS = 4
"""At most."""


def is_picture(data: bytes, name: str) -> bool:
    """Whether a file of arrays holds a picture, and nothing that may be a light field. `name` is for messages."""
    return _find_picture(data, name) is not None


def is_rounded(data: bytes) -> bool:
    """Whether samples are floating-point numbers, which are rounded to 16 bit."""
    found = _find_picture(data, "")
    return found is not None and found[1].is_float


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Its pixels, `(H, W, C)`; and an orientation, 1: upright. `is_picture` must have found it."""
    found = _find_picture(data, name)
    if found is None:
        raise ValueError(name)
    key, (size, _) = found
    height, width, channels = (*size, 1)[:3]
    check_size(height, width)
    array = _read_array(data, key, name)
    shape = (1, 1, height, width, channels)
    check_array(name, shape, array.dtype, DEFAULT_LIMITS)
    views, _ = convert_samples(array.reshape(shape), name)
    return views[0, 0], 1


def _find_picture(data: bytes, name: str) -> tuple[str, Header] | None:
    """The name of the picture's array in its file, and its header; None where there is none, or several may be."""
    headers = _list_headers(data, name)
    if any(header is None or (len(header.shape) > 2 and not _has_axes(header)) for header in headers.values()):
        return None
    found = [(key, header) for key, header in headers.items() if header is not None and _has_axes(header)]
    if len(found) > 1:
        found = [(key, header) for key, header in found if min(header.shape[:2]) >= LEAST_SIDE]
    return found[0] if len(found) == 1 else None


def _has_axes(header: Header) -> bool:
    return len(header.shape) == 2 or (len(header.shape) == 3 and header.shape[2] <= CHANNELS)


def _list_headers(data: bytes, name: str) -> Mapping[str, Header | None]:
    """Of all arrays of numbers; None for what may hold others."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return {"": arrays.Array(data, name).header}
    if data.startswith(b"PK"):
        return arrays.list_headers(data, name)
    from ciir.renderer.readers.containers import hdf5, mat  # they import h5py

    return mat.list_headers(data) if data.startswith(mat.VERSION_5) else hdf5.list_headers(data)


def _read_array(data: bytes, key: str, name: str) -> NDArray[Any]:
    """The array `key`, `(H, W)` or `(H, W, C)`."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return arrays.Array(data, name).read()
    if data.startswith(b"PK"):
        return arrays.read_array(data, key, name)
    from ciir.renderer.readers.containers import hdf5, mat

    read = mat.read_array if data.startswith(mat.VERSION_5) else hdf5.read_array
    return read(data, key, name)
