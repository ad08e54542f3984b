"""Elemental image arrays and mosaics as one array, `(H, W)` or `(H, W, C)`, in NPY, NPZ, MAT and HDF5."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import UnsupportedType
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
    return find_picture(_list_headers(data, name, limits)) is not None


def read(data: bytes, name: str, limits: Limits) -> tuple[Pixels, tuple[str, ...]]:
    """The pixels `(H, W, C)` of the picture that `is_picture` finds, with a note where they were rounded to 16 bit.

    Raises `TooLarge` over `limits`, `UnsupportedType` for samples that are neither uint8, uint16 nor floating-point,
    and `Unreadable` for floating-point ones that are not from 0 to 1.
    """
    headers = _list_headers(data, name, limits)
    key = find_picture(headers)
    if key is None:
        raise ValueError(name)
    what = f"{name}: {clean_text(key) or 'the array'}"
    height, width = headers[key].shape[:2]
    pictures.check_size(height, width, name=name, max_pixels=limits.pixels)
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


def find_picture(headers: Mapping[str, Header]) -> str | None:
    """The key of the only array that is a picture by its axes and size, of those that can be read if there are any.
    None where there is another number of them, a light field, other views, or a struct or group of as many bytes, which
    may hold one.
    """
    if holds_light_field({key: header.shape for key, header in headers.items()}):
        return None
    found = {key: header for key, header in headers.items() if has_axes_of_picture(header.shape)}
    found = {key: header for key, header in found.items() if header.is_read} or found
    if len(found) != 1:
        return None
    ((key, picture),) = found.items()
    is_open = any(_may_hold_views(header, picture.bytes) for header in headers.values() if header is not picture)
    return None if is_open else key


def _may_hold_views(header: Header, size: int) -> bool:
    """Whether it is an array of views of a picture's size, or may hold some that come to at least `size` bytes."""
    if not header.shape:
        return header.bytes >= size
    return not has_axes_of_picture(header.shape) and sum(side >= PICTURE_SIDE for side in header.shape) > 1


def _list_headers(data: bytes, name: str, limits: Limits) -> Mapping[str, Header]:
    """Of everything in the file that is or may hold numbers, by name; of the array in an NPY by an empty one."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return {"": arrays.Array(data, name).header}
    if data.startswith(b"PK"):
        return arrays.list_headers(data, name, limits)
    from ciir.renderer.readers.containers import hdf5, mat  # they import h5py

    return mat.list_headers(data, name) if data.startswith(mat.VERSION_5) else hdf5.list_headers(data)


def _read_array(data: bytes, key: str, what: str, limits: Limits) -> NDArray[Any]:
    """The array `key`, `(H, W)` or `(H, W, C)`; `what` names it in messages."""
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        return arrays.Array(data, what).read()
    if data.startswith(b"PK"):
        return arrays.read_array(data, key, what, limits)
    from ciir.renderer.readers.containers import hdf5, mat

    if data.startswith(mat.VERSION_5):
        return mat.read_array(data, key, what, limits)
    return hdf5.read_array(data, key, what, limits)
