"""Reads elemental image arrays and mosaics stored as one array, `(H, W)` or `(H, W, C)`, in NPY, NPZ, MAT and HDF5."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, UnsupportedType
from ciir.renderer.levels import ROUNDED, round_samples
from ciir.renderer.readers import pictures
from ciir.renderer.readers.containers import arrays
from ciir.renderer.readers.containers.samples import (
    NEEDED_TYPES,
    PICTURE_SIDE,
    advise_type,
    has_axes_of_picture,
    holds_light_field,
    is_type_read,
)
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.containers.samples import Header
    from ciir.renderer.readers.pictures import Pixels

ROWS = 256
"""How many rows of floating-point samples are rounded at once, to keep temporary arrays small."""


def is_picture(data: bytes, name: str, limits: Limits) -> bool:
    """Returns whether a file of arrays holds a picture and no light field. `name` is for messages."""
    return _find(data, name, limits) is not None


def read(data: bytes, name: str, limits: Limits) -> tuple[Pixels, tuple[str, ...]]:
    """Reads the pixels `(H, W, C)` of the picture that `is_picture` finds, with a note if they were rounded to 16 bit.

    Raises `TooLarge` over `limits`, `UnsupportedType` for samples that are neither uint8, uint16 nor floating-point,
    and `Unreadable` for floating-point samples outside 0 to 1.
    """
    found = _find(data, name, limits)
    if found is None:
        raise ValueError(name)
    key, header = found
    what = f"{name}: {clean_text(key) or 'the array'}"
    height, width = header.shape[:2]
    pictures.check_size(height, width, name=name, max_pixels=limits.pixels)
    if header.bytes > limits.set_bytes:
        size = f"comes to {header.bytes:,} bytes; at most {limits.set_bytes:,} are read"
        raise TooLarge(f"{what} {size}; give a smaller one, or uint8", "set_bytes")
    array = _read_array(data, key, what, limits)
    if not is_type_read(array.dtype):
        raise UnsupportedType(f"{what} is of {str(array.dtype)[:40]}; give {NEEDED_TYPES}{advise_type(array.dtype)}")
    array = array.reshape(height, width, math.prod(array.shape[2:]))
    if array.dtype.kind == "u":
        return np.ascontiguousarray(array, array.dtype.newbyteorder("=")), ()
    rounded = np.empty(array.shape, np.uint16)
    for top in range(0, height, ROWS):
        rounded[top : top + ROWS] = round_samples(array[top : top + ROWS], what, array)
    return rounded, (ROUNDED,)


def _find(data: bytes, name: str, limits: Limits) -> tuple[str, Header] | None:
    """Returns the name of the picture in its file, and its header.

    Returns None if the file also holds a light field, even in a struct or group, or other views.
    """
    headers = _list_headers(data, name, limits)
    arrays_ = {key: header for key, header in headers.items() if header is not None}
    key = find_picture(arrays_)
    if key is None or (len(arrays_) < len(headers) and holds_light_field(_list_inner_shapes(data, name, limits))):
        return None
    return key, arrays_[key]


def find_picture(headers: Mapping[str, Header]) -> str | None:
    """Returns the key of the only array with the axes and size of a picture.

    If some of these arrays have a type that is read, only those count. Returns None if none or several are left, and if
    there is a light field or an array of views of a picture's size.
    """
    shapes = {key: header.shape for key, header in headers.items()}
    found = [key for key, shape in shapes.items() if has_axes_of_picture(shape)]
    if holds_light_field(shapes) or any(_holds_views(shape) for shape in shapes.values()):
        return None
    found = [key for key in found if headers[key].is_read] or found
    return found[0] if len(found) == 1 else None


def _holds_views(shape: tuple[int, ...]) -> bool:
    return not has_axes_of_picture(shape) and len(shape) > 2 and sum(side >= PICTURE_SIDE for side in shape) > 1


def _list_headers(data: bytes, name: str, limits: Limits) -> Mapping[str, Header | None]:
    """Returns the headers of a file's arrays of numbers by name, and None for structs and groups. The array of an NPY
    file has an empty name.
    """
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return {"": arrays.Array(data, name).header}
    if data.startswith(b"PK"):
        return arrays.list_headers(data, name, limits)
    from ciir.renderer.readers.containers import hdf5, mat  # these import h5py

    return mat.list_headers(data, name) if data.startswith(mat.VERSION_5) else hdf5.list_headers(data)


def _list_inner_shapes(data: bytes, name: str, limits: Limits) -> Mapping[str, tuple[int, ...]]:
    """Returns the shapes of arrays in structs or groups, down to the depth at which light fields are searched for."""
    from ciir.renderer.readers.containers import hdf5, mat

    if data.startswith(mat.VERSION_5):
        return mat.list_inner_shapes(data, name, limits)
    return hdf5.list_inner_shapes(data)


def _read_array(data: bytes, key: str, what: str, limits: Limits) -> NDArray[Any]:
    """Reads the array `key`, `(H, W)` or `(H, W, C)`; `what` names it in messages."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return arrays.Array(data, what).read()
    if data.startswith(b"PK"):
        return arrays.read_array(data, key, what, limits)
    from ciir.renderer.readers.containers import hdf5, mat

    if data.startswith(mat.VERSION_5):
        return mat.read_array(data, key, what, limits)
    return hdf5.read_array(data, key, what)
