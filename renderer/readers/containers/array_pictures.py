"""Elemental image arrays and mosaics as one array, `(H, W)` or `(H, W, C)`, in NPY, NPZ, MAT and HDF5."""

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
"""Rows of floating-point samples that are rounded at once, so that temporary arrays are small."""


def is_picture(data: bytes, name: str, limits: Limits) -> bool:
    """Whether a file of arrays holds a picture, and no light field. `name` is for messages."""
    return _find(data, name, limits) is not None


def read(data: bytes, name: str, limits: Limits) -> tuple[Pixels, tuple[str, ...]]:
    """The pixels `(H, W, C)` of the picture that `is_picture` finds, with a note where they were rounded to 16 bit.

    Raises `TooLarge` over `limits`, `UnsupportedType` for samples that are neither uint8, uint16 nor floating-point,
    and `Unreadable` for floating-point ones that are not from 0 to 1.
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
        raise UnsupportedType(f"{what} is of {str(array.dtype)[:40]}; give {NEEDED_TYPES}")
    array = array.reshape(height, width, math.prod(array.shape[2:]))
    if array.dtype.kind == "u":
        return np.ascontiguousarray(array, array.dtype.newbyteorder("=")), ()
    rounded = np.empty(array.shape, np.uint16)
    for top in range(0, height, ROWS):
        rounded[top : top + ROWS] = round_samples(array[top : top + ROWS], what, array)
    return rounded, (ROUNDED,)


def _find(data: bytes, name: str, limits: Limits) -> tuple[str, Header] | None:
    """The name of the picture in its file, and its header; None where a light field is there, in a struct or group too,
    or other views.
    """
    headers = _list_headers(data, name, limits)
    arrays_ = {key: header for key, header in headers.items() if header is not None}
    key = find_picture(arrays_)
    if key is None or (len(arrays_) < len(headers) and holds_light_field(_list_inner_shapes(data, name, limits))):
        return None
    return key, arrays_[key]


def find_picture(headers: Mapping[str, Header]) -> str | None:
    """The key of the only array that is a picture by its axes and size, of those that can be read if there are any.
    None where there is another number of them, a light field, or an array of views of a picture's size.
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
    """Of the arrays of numbers in a file, by name, that in an NPY by an empty one; None of structs and groups."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return {"": arrays.Array(data, name).header}
    if data.startswith(b"PK"):
        return arrays.list_headers(data, name, limits)
    from ciir.renderer.readers.containers import hdf5, mat  # they import h5py

    return mat.list_headers(data, name) if data.startswith(mat.VERSION_5) else hdf5.list_headers(data)


def _list_inner_shapes(data: bytes, name: str, limits: Limits) -> Mapping[str, tuple[int, ...]]:
    """The shapes of what structs or groups hold, as deep as light fields are looked for."""
    from ciir.renderer.readers.containers import hdf5, mat

    if data.startswith(mat.VERSION_5):
        return mat.list_inner_shapes(data, name, limits)
    return hdf5.list_inner_shapes(data)


def _read_array(data: bytes, key: str, what: str, limits: Limits) -> NDArray[Any]:
    """The array `key`, `(H, W)` or `(H, W, C)`; `what` names it in messages."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return arrays.Array(data, what).read()
    if data.startswith(b"PK"):
        return arrays.read_array(data, key, what, limits)
    from ciir.renderer.readers.containers import hdf5, mat

    if data.startswith(mat.VERSION_5):
        return mat.read_array(data, key, what, limits)
    return hdf5.read_array(data, key, what)
