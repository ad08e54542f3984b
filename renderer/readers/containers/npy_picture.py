"""NPY of one picture, `(H, W)` or `(H, W, C)`: an elemental image array, or a mosaic of views."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.containers.arrays import Array
from ciir.renderer.readers.containers.samples import check_array, convert_samples

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels


def is_picture(data: bytes, name: str) -> bool:
    """Whether the array in `data` has the axes of a picture."""
    shape = Array(data, name).shape
    return len(shape) == 2 or (len(shape) == 3 and shape[2] <= 4)


def is_rounded(data: bytes) -> bool:
    """Whether samples are floating-point numbers, which are rounded to 16 bit."""
    return Array(data, "").dtype.kind == "f"


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Its pixels, `(H, W, C)`; and an orientation, 1: upright."""
    array = Array(data, name)
    height, width, channels = (*array.shape, 1)[:3]
    check_size(height, width)
    shape = (1, 1, height, width, channels)
    check_array(name, shape, array.dtype, DEFAULT_LIMITS)
    views, _ = convert_samples(array.read().reshape(shape), name)
    return views[0, 0], 1
