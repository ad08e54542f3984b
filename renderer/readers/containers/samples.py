"""Turns arrays in files into light fields: checks their sizes, and rounds floating-point samples to 16 bit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED, round_samples
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.pictures import MAX_SIDE
from ciir.renderer.views import advise_axes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import DTypeLike, NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.views import DepthSense


class Header(NamedTuple):
    """The description of an array, which precedes its samples."""

    shape: tuple[int, ...]
    bytes: int
    """The size of the samples, unpacked."""
    is_read: bool = True
    """Whether the samples have a type that is read."""


PICTURE_SIDE = 16
"""The least pixels along each side of a picture. Smaller arrays are something else, such as the matrix of a camera."""
NEEDED_TYPES = "uint8, uint16, or floating-point numbers from 0 to 1"
"""The sample types that are read, for messages."""
LOGICAL = "logical"
"""MATLAB's class of true and false, stored as 1 and 0 of 8 bits."""
_WHOLE_NUMBERS = ("int8", "int16", "int32", "int64", "uint32", "uint64")
"""MATLAB's classes of whole numbers that are not read."""
TAKEN_AS_CAMERAS = (
    "depth: the file doesn't say what u and v count; they are taken as cameras from the left and from the top; if "
    "near and far are exchanged, as for pixels under a lens array, give depth_sense lenses"
)
"""The note for a file that doesn't state its depth sense."""


def settle_depth_sense(stated: object, layout: Layout) -> tuple[DepthSense, tuple[str, ...]]:
    """Returns the depth sense that `layout` gives, else the one that the file states, else that of cameras, with a
    note.
    """
    found = layout.depth_sense or stated
    if found == "lenses":
        return "lenses", ()
    return "cameras", () if found == "cameras" else (TAKEN_AS_CAMERAS,)


def holds_light_field(shapes: Mapping[str, Sequence[int]]) -> bool:
    """Returns whether one of a file's arrays has the name or the number of axes of a light field."""
    return len(shapes.get("LF", ())) in (4, 5) or any(len(shape) == 5 for shape in shapes.values())


def find_light_field(shapes: Mapping[str, Sequence[int]], name: str, remedy: str, cells: str = "") -> str:
    """Returns the name of the light field among a file's arrays: `LF`, or else the only one with five axes, or else the
    only one with four.

    Raises `Unreadable` if there is none or there are several. The message has the `remedy` and, in `cells`, the reason
    why cell arrays hold no views.
    """
    if len(shapes.get("LF", ())) in (4, 5):
        return "LF"
    for axes, counted in ((5, "five"), (4, "four")):
        found = [key for key, shape in shapes.items() if len(shape) == axes]
        if len(found) == 1:
            return found[0]
        if found:
            listed = ", ".join(map(clean_text, found[:5]))
            raise Unreadable(f"{name}: {len(found)} arrays have {counted} axes ({listed}); name the light field LF")
    shapes = {key: shape for key, shape in shapes.items() if not key.startswith("#")}  # MATLAB's own, such as #refs#
    listed = ", ".join(f"{clean_text(key)} {show_shape(shapes[key])}".strip() for key in list(shapes)[:5])
    if any(has_axes_of_picture(shape) or has_axes_of_picture(shape[::-1]) for shape in shapes.values()):
        remedy += (
            ", or an elemental image array, (H, W) or (H, W, C), without other pictures, outside structs and groups"
        )
    if cells:
        listed, remedy = (
            f"{listed}; {cells}",
            f"pictures of one size and class, {PICTURE_SIDE}x{PICTURE_SIDE} or more, in several cells, or {remedy}",
        )
    raise Unreadable(f"{name}: holds {listed or 'nothing'}; give {remedy}")


def show_shape(shape: Sequence[int]) -> str:
    """Formats a shape for messages, such as `480x640x3`."""
    return "x".join(map(str, shape))[:60]


def has_axes_of_picture(shape: Sequence[int]) -> bool:
    """Returns whether an array has the axes `(H, W)` or `(H, W, C)` and the size of a picture."""
    return (len(shape) == 2 or (len(shape) == 3 and 1 <= shape[2] <= 4)) and min(shape[:2]) >= PICTURE_SIDE


def is_type_read(dtype: DTypeLike) -> bool:
    """Returns whether samples of that type are read."""
    return np.dtype(dtype).newbyteorder("=") in (np.uint8, np.uint16, np.float16, np.float32, np.float64)


def advise_type(dtype: DTypeLike, name: str = "array") -> str:
    """Returns the end of a message that asks for `NEEDED_TYPES`: code that makes them of an array `name` of another
    type, of which only the header is known.
    """
    kind = np.dtype(dtype).kind
    if kind == "b":
        return f", as in 255 * {name}.astype('u1')"
    if kind in "iu":
        return f", as in {name}.clip(0, 255).astype('u1') for levels up to 255, else {name}.clip(0, 65535).astype('u2')"
    return {"c": f", as in np.abs({name})", "f": f", as in {name}.astype('f8')"}.get(kind, "")


def refuse_class(kind: str, name: str, *, known: Sequence[str] | None = None) -> None:
    """Raises `UnsupportedType` for a class of MATLAB whose numbers are not read, with code that converts them, and for
    any that is not `known` if these are given.

    The 1 of `logical` is white and would be read as nearly black. `name` ends with that of the variable.
    """
    variable = name.rpartition(": ")[2]
    if kind == LOGICAL:
        raise UnsupportedType(f"{name} is of class {kind}; give uint8, as in 255 * uint8({variable})")
    advice = ""
    if kind.startswith("complex "):
        advice = f", as in abs({variable})"
    elif kind in _WHOLE_NUMBERS:
        advice = f", as in uint8({variable}) for levels up to 255, else uint16({variable})"
    if advice or (known is not None and kind not in known):
        raise UnsupportedType(f"{name} is of class {kind}; give uint8, uint16, or single or double from 0 to 1{advice}")


def check_array(name: str, shape: Sequence[int], dtype: DTypeLike, limits: Limits, advice: str = "") -> None:
    """Checks that an array can be a light field `(V, U, H, W, C)`. The file's header gives its shape and type, before
    anything is read. `advice` is the remedy for too many views if these are not meant to be views (`Axes.advice`).

    Raises `UnsupportedType` for samples that are neither uint8, uint16 nor floating-point, `Unreadable` for any other
    shape, and `TooLarge` over `limits`.
    """
    dtype = np.dtype(dtype)
    what = f"{name}: an array {show_shape(shape)} of {str(dtype)[:40]}"
    if not is_type_read(dtype):
        raise UnsupportedType(f"{what}; give {NEEDED_TYPES}{advise_type(dtype)}")
    if len(shape) != 5 or min(shape) < 1 or shape[4] > 4:
        raise Unreadable(
            f"{what}; give (V, U, H, W, C): rows and columns of views, and of pixels, 1 to 4 channels"
            + advise_axes(shape, "array")
        )
    views_v, views_u, height, width, _ = shape
    if views_v * views_u > limits.views:
        too_many = f"{what}; at most {limits.views:,} views are read"
        if advice:
            raise TooLarge(f"{too_many}; {advice}")
        raise TooLarge(f"{too_many}; give fewer", "views")
    if height * width > limits.pixels or max(height, width) > MAX_SIDE:
        raise TooLarge(f"{what}; at most {limits.pixels:,} pixels of a view are read; give smaller views", "pixels")
    size = math.prod(shape) * dtype.itemsize
    if size > limits.set_bytes:
        raise TooLarge(
            f"{what} comes to {size:,} bytes; at most {limits.set_bytes:,} are read; give fewer views or smaller ones",
            "set_bytes",
        )


def convert_samples(array: NDArray[Any], name: str) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Converts `(V, U, H, W, C)` to uint8 or uint16 in the machine's byte order, with a note if it was rounded.

    Raises `Unreadable` for floating-point samples outside 0 to 1.
    """
    if array.dtype.kind == "u":
        return array.astype(array.dtype.newbyteorder("="), copy=False), ()
    rounded = np.empty(array.shape, np.uint16)
    for v, u in np.ndindex(array.shape[:2]):  # one view at a time: the temporary arrays are small
        rounded[v, u] = round_samples(array[v, u], f"{name}: view {v},{u}", array)
    return rounded, (ROUNDED,)
