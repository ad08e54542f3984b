"""Finds which axes of a file's array count views, and which ones pixels: `(V, U, H, W, C)`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from ciir.errors import InvalidOption
from ciir.renderer.readers.containers.samples import PICTURE_SIDE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.readers.layout import Layout

_GIVE = "give pixels ROWSxCOLUMNS (of views)"
_LAST, _SECOND = (3, 0, 1, 2), (0, 2, 3, 1)
"""The axes of `(H, W, C, N)` and of `(N, C, H, W)` in the order `(N, H, W, C)`."""


class Axes(NamedTuple):
    """How a file's array becomes a light field."""

    shape: tuple[int, ...]
    """The shape `(V, U, H, W, C)`; for an array that is none, its own."""
    notes: tuple[str, ...] = ()
    advice: str = ""
    """What to do if there are too many views; empty if no other axes are likely."""
    order: tuple[int, ...] | None = None
    """The order that makes four axes `(N, H, W, C)`; None if they are in order."""

    def arrange(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Returns the samples of the array with this shape; shares memory if they are in order."""
        if self.order is not None:
            samples = samples.reshape(samples.shape[:4]).transpose(self.order)
        return samples.reshape(self.shape)


def settle_axes(shape: Sequence[int], layout: Layout, name: str) -> Axes:
    """Returns how an array of `shape` becomes `(V, U, H, W, C)`, with notes if it may have other axes.

    `(V, U, H, W)` gets an axis of channels. Views one after another become the grid that `settle_grid` finds, with its
    notes: `(N, H, W, C)` with up to four channels, `(N, H, W)`, and `(H, W, 3, N)`, as `cat(4, ...)` of MATLAB makes
    it. If `layout.pixels` has N views, so do `(H, W, 1, N)`, `(N, 3, H, W)` and `(N, 1, H, W)`. Other shapes stay as
    they are.

    Raises `InvalidOption` if `layout.pixels` shows that the array has other axes.
    """
    shape = tuple(shape)
    order, noted = _find_order(shape, layout)
    if order is not None:
        sizes = [shape[axis] for axis in order]
        is_few = order == _LAST and sizes[0] <= min(shape[:2]) // 4
        advice = f"; {_advise_exchange(shape)}" if is_few and layout.pixels is None else ""
        grid, notes = settle_grid(sizes[0], layout, name, "views", advice=advice)
        return Axes((*grid, *sizes[1:]), notes + noted, order=order)
    if shape[:1] > (0,) and ((len(shape) == 4 and shape[3] <= 4) or (len(shape) == 3 and shape[2] > 4)):
        grid, notes = settle_grid(shape[0], layout, name, "views", advice=_advise_views_last(shape, layout))
        return Axes((*grid, *shape[1:3], *(shape[3:] or (1,))), notes)
    whole = (*shape, 1) if len(shape) == 4 else shape
    advice = "" if layout.pixels == shape[:2] else _advise_exchange(shape)
    if advice and layout.pixels == shape[2:4]:
        views, pixels = ("{}x{}".format(*sizes) for sizes in (shape[:2], shape[2:4]))
        raise InvalidOption(f"pixels: {name} has {views} views of {pixels} pixels; {advice}")
    notes = _note_colours(shape) or (_note_exchange(shape) if advice else _note_colours_first(shape))
    return Axes(whole, notes, advice)


def _find_order(shape: tuple[int, ...], layout: Layout) -> tuple[tuple[int, ...] | None, tuple[str, ...]]:
    """Returns the order of axes that makes `(N, H, W, C)` of colour views before or behind their pixels, else None; and
    a note if the order is not certain.
    """
    if len(shape) != 4 or min(shape) < 1:
        return None, ()
    asked = math.prod(layout.pixels) if layout.pixels else None
    is_grid = layout.pixels in (shape[:2], shape[2:4])  # of grey views, (V, U, H, W) or (H, W, V, U)
    if shape[2] in (1, 3) and not is_grid and asked == shape[3] != shape[0]:
        return _LAST, ()
    if shape[1] in (1, 3) and not is_grid and asked == shape[0] and shape[3] > 4:
        return _SECOND, ()
    if shape[2] == 3 and shape[3] > 4 and min(shape[:2]) >= PICTURE_SIDE and not is_grid:
        return _LAST, (f"axes: taken as (H, W, 3, N), {shape[3]} views of {shape[0]}x{shape[1]} pixels",)
    return None, ()


def _note_colours(shape: tuple[int, ...]) -> tuple[str, ...]:
    """Returns a note on grey views `(V, U, H, W)` that may be `(N, C, H, W)` or `(H, W, 1, N)`."""
    if len(shape) != 4 or shape[3] <= 4:
        return ()
    if shape[1] in (1, 3):
        count, channels = shape[:2]
        colours = "3 colours" if channels == 3 else "one channel"
        note = f"{count}x{channels} grey views; if they are {count} views of {colours}, (N, {channels}, H, W)"
        return (f"axes: {note}, {_GIVE}",)
    if shape[2] == 1 and min(shape[:2]) >= PICTURE_SIDE:
        size, count = f"{shape[0]}x{shape[1]}", shape[3]
        note = f"{size} grey views of 1x{count} pixels; if they are {count} views of {size} pixels, (H, W, 1, N)"
        return (f"axes: {note}, {_GIVE}",)
    return ()


def _note_colours_first(shape: tuple[int, ...]) -> tuple[str, ...]:
    """Returns a note on views `(V, U, H, W, C)` that may be `(C, H, W, V, U)`."""
    if len(shape) != 5 or shape[0] not in (1, 3) or not max(shape[3:]) <= 4 < min(shape[1:3]):
        return ()
    note = "axes: {}x{} views of {}x{} pixels; if the array is (C, H, W, V, U), save array.transpose(3, 4, 1, 2, 0)"
    return (note.format(*shape),)


def _advise_views_last(shape: tuple[int, ...], layout: Layout) -> str:
    """Returns the end of a message on `(N, H, W)` or `(N, H, W, C)` that may be `(H, W, N)`, `(H, W, N, C)`,
    `(H, W, 3, N)` or, with views of few columns, `(H, W, V, U)`; else an empty text.
    """
    rows, columns, count = shape[:3]
    if len(shape) == 4 and count <= max(4, min(rows, columns) // 4):
        colours = ""
        if count == 3 and shape[3] > 1:
            colours = f"; if they are {shape[3]} views of 3 colours, (H, W, 3, N), give pixels 1x{shape[3]}"
        return (
            f"; if they are {count}x{shape[3]} grey views of {rows}x{columns} pixels, (H, W, V, U), save "
            f"array.transpose(2, 3, 0, 1){colours}"
        )
    asked = math.prod(layout.pixels) if layout.pixels else math.isqrt(count) ** 2
    if asked != count or min(rows, columns) <= count:
        return ""
    return f"; if they are {count} views of {rows}x{columns} pixels, save np.moveaxis(array, 2, 0)"


def _note_exchange(shape: tuple[int, ...]) -> tuple[str, ...]:
    """Returns a note on `(V, U, H, W, C)` or `(V, U, H, W)` that may be `(H, W, V, U, C)` or `(H, W, V, U)`."""
    advice = _advise_exchange(shape)
    return ("axes: {}x{} views of {}x{} pixels; {}".format(*shape[:4], advice),) if advice else ()


def _advise_exchange(shape: tuple[int, ...]) -> str:
    """Returns the remedy for an array that has more rows and columns of views than of pixels, else an empty text."""
    if len(shape) not in (4, 5) or not (shape[0] > shape[2] and shape[1] > shape[3]):
        return ""
    colours, order = (", C", "2, 3, 0, 1, 4") if len(shape) == 5 else ("", "2, 3, 0, 1")
    return (
        f"if these are {shape[2]}x{shape[3]} views of {shape[0]}x{shape[1]} pixels, (H, W, V, U{colours}), save "
        f"array.transpose({order})"
    )


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
