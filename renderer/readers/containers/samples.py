"""Turns arrays in files into light fields: checks their sizes, and rounds floating-point samples to 16 bit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
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


def settle_grid(
    count: int,
    layout: Layout,
    name: str,
    things: str,
    stated: tuple[int, int] | None = None,
    *,
    advice: str = "",
) -> tuple[tuple[int, int], tuple[str, ...]]:
    """Returns the rows and columns of `count` views that lie one after another in a file, and notes.

    They are those of `layout.pixels`, else the `stated` ones, else a square, with a note. Raises `InvalidOption` if the
    views fill none of these. With `order` columns the views fill columns, and the grid is the transposed one. `things`
    is what the file calls the views, and `advice` is the end of messages.
    """
    asked = layout.pixels
    if asked is not None:
        if asked[0] * asked[1] != count:
            raise InvalidOption(
                f"pixels: {asked[0]}x{asked[1]} asks for {asked[0] * asked[1]} views, but {name} has {count} {things}; "
                f"give the rows and columns of views{advice}"
            )
        return layout.sequence or asked, ()
    if stated is not None and stated[0] * stated[1] == count:
        return stated, ()
    side = math.isqrt(count)
    if side * side != count:
        raise InvalidOption(
            f"{name}: {count} {things}, which is not a square number; give pixels ROWSxCOLUMNS (of views){advice}"
        )
    return (side, side), (
        f"the {count} {things} are taken as {side}x{side} views, row by row; pixels gives another grid{advice}",
    )


def settle_axes(shape: Sequence[int], layout: Layout, name: str) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Returns the shape of a file's array as `(V, U, H, W, C)`, and notes.

    `(V, U, H, W)` gets an axis of channels. Views one after another, `(N, H, W, C)` with up to four channels or
    `(N, H, W)`, become the grid that `settle_grid` finds, with its notes. Other shapes are returned as they are. A note
    is added if the array may have other axes.

    Raises `InvalidOption` if `layout.pixels` shows that it has.
    """
    shape = tuple(shape)
    if shape[:1] > (0,) and ((len(shape) == 4 and shape[3] <= 4) or (len(shape) == 3 and shape[2] > 4)):
        grid, notes = settle_grid(shape[0], layout, name, "views", advice=_advise_views_last(shape, layout))
        return (*grid, *shape[1:3], *(shape[3:] or (1,))), notes
    if len(shape) == 4:
        return (*shape, 1), _note_colours(shape, layout, name)
    is_reversed = len(shape) == 5 and shape[0] in (1, 3) and max(shape[3:]) <= 4 < min(shape[1:3])
    note = "axes: {}x{} views of {}x{} pixels; if the array is (C, H, W, V, U), save array.transpose(3, 4, 1, 2, 0)"
    return shape, (note.format(*shape),) if is_reversed else ()


def _note_colours(shape: Sequence[int], layout: Layout, name: str) -> tuple[str, ...]:
    """Returns a note on grey views `(V, U, H, W)` that may be `(N, 3, H, W)` or `(N, 1, H, W)`."""
    count, channels = shape[:2]
    if channels not in (1, 3):
        return ()
    colours = "3 colours" if channels == 3 else "one channel"
    advice = f"{count}x{channels} grey views; if they are {count} views of {colours}, (N, {channels}, H, W), save "
    advice += f"np.moveaxis(array, 1, -1), (N, H, W, {channels})"
    if layout.pixels and count == math.prod(layout.pixels) and (count, channels) != layout.pixels:
        raise InvalidOption(f"pixels: {name} has {advice}")
    return (f"axes: {advice}",)


def _advise_views_last(shape: Sequence[int], layout: Layout) -> str:
    """Returns the end of a message on `(N, H, W)` or `(N, H, W, C)` that may be `(H, W, N)`, `(H, W, N, C)` or, with
    views of few columns, `(H, W, V, U)`; else an empty text.
    """
    rows, columns, count = shape[:3]
    if len(shape) == 4 and count <= max(4, min(rows, columns) // 4):
        return (
            f"; if they are {count}x{shape[3]} grey views of {rows}x{columns} pixels, (H, W, V, U), save "
            "array.transpose(2, 3, 0, 1)"
        )
    asked = math.prod(layout.pixels) if layout.pixels else math.isqrt(count) ** 2
    if asked != count or min(rows, columns) <= count:
        return ""
    return f"; if they are {count} views of {rows}x{columns} pixels, save np.moveaxis(array, 2, 0)"


def holds_light_field(shapes: Mapping[str, Sequence[int]]) -> bool:
    """Returns whether one of a file's arrays has the name or the number of axes of a light field."""
    return len(shapes.get("LF", ())) in (4, 5) or any(len(shape) == 5 for shape in shapes.values())


def find_light_field(shapes: Mapping[str, Sequence[int]], name: str, remedy: str, cells: str = "") -> str:
    """Returns the name of the light field among a file's arrays: `LF`, or else the only one with five axes.

    Raises `Unreadable` if there is none or there are several. The message has the `remedy` and, in `cells`, the reason
    why cell arrays hold no views.
    """
    if len(shapes.get("LF", ())) in (4, 5):
        return "LF"
    found = [key for key, shape in shapes.items() if len(shape) == 5]
    if len(found) == 1:
        return found[0]
    if found:
        listed = ", ".join(map(clean_text, found[:5]))
        raise Unreadable(f"{name}: {len(found)} arrays have five axes ({listed}); name the light field LF")
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


def check_array(name: str, shape: Sequence[int], dtype: DTypeLike, limits: Limits) -> None:
    """Checks that an array can be a light field `(V, U, H, W, C)`. The file's header gives its shape and type, before
    anything is read.

    Raises `UnsupportedType` for samples that are neither uint8, uint16 nor floating-point, `Unreadable` for any other
    shape, and `TooLarge` over `limits`.
    """
    dtype = np.dtype(dtype)
    what = f"{name}: an array {show_shape(shape)} of {str(dtype)[:40]}"
    if not is_type_read(dtype):
        raise UnsupportedType(f"{what}; give {NEEDED_TYPES}")
    if len(shape) != 5 or min(shape) < 1 or shape[4] > 4:
        raise Unreadable(
            f"{what}; give (V, U, H, W, C): rows and columns of views, and of pixels, 1 to 4 channels"
            + advise_axes(shape, "array")
        )
    views_v, views_u, height, width, _ = shape
    if views_v * views_u > limits.views:
        raise TooLarge(f"{what}; at most {limits.views:,} views are read; give fewer", "views")
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
