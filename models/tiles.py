"""Pictures in parts: windows whose halo is no smaller than the receptive field, so that tiled equals whole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

Span = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Tile:
    """One window of a picture and the part of its result that is kept."""

    window: Span
    """What to read, halo included, in input pixels."""
    kept: Span
    """What its result is good for, in input pixels; the kept spans of all tiles cover the picture once."""

    def within(self, other: Tile) -> Tile:
        """This one, placed in the window of `other`, as a part of `other`: no more is kept than of that."""
        window, kept = [], []
        for side, good, outer, limit in zip(self.window, self.kept, other.window, other.kept, strict=True):
            window.append(_scaled(side, 1, origin=-outer.start))
            start = min(max(good.start + outer.start, limit.start), limit.stop)
            kept.append(slice(start, max(start, min(good.stop + outer.start, limit.stop))))
        return Tile((window[0], window[1]), (kept[0], kept[1]))

    def source(self, scale: int) -> Span:
        """The kept part within the window's result, in output pixels."""
        rows, cols = (_scaled(k, scale, origin=w.start) for k, w in zip(self.kept, self.window, strict=True))
        return rows, cols

    def inside(self, part: Span) -> Span:
        """The window within a part of the picture that holds it."""
        rows, cols = (_scaled(w, 1, origin=p.start) for w, p in zip(self.window, part, strict=True))
        return rows, cols

    def target(self, scale: int) -> Span:
        """The kept part within the whole result, in output pixels."""
        rows, cols = (_scaled(k, scale, origin=0) for k in self.kept)
        return rows, cols


def _scaled(span: slice, scale: int, *, origin: int) -> slice:
    return slice((span.start - origin) * scale, (span.stop - origin) * scale)


def split(height: int, width: int, *, radius: int, window: int, multiple: int = 1) -> Iterator[Tile]:
    """Windows of at most `window` pixels over a picture of `height x width`, row by row.

    Each keeps `radius` pixels between what is kept and any edge of the window that is not the picture's own. All
    windows of a picture have one size, so that a runtime plans for one shape. Where the picture's sides are multiples
    of `multiple`, so are the sides and places of all windows.

    Raises `ValueError` where no square of `window` pixels is wider than its halo.
    """
    radius = math.ceil(radius / multiple) * multiple
    side = math.isqrt(window) // multiple * multiple
    if side <= 2 * radius:
        raise ValueError(
            f"a window of {window} pixels has nothing inside a halo of {radius}; give over {4 * radius**2}"
        )
    if height <= side:
        rows, cols = height, window // height
    elif width <= side:
        rows, cols = window // width, width
    else:
        rows, cols = side, side
    for row_window, row_kept in _spans(height, rows, radius, multiple):
        for col_window, col_kept in _spans(width, cols, radius, multiple):
            yield Tile((row_window, col_window), (row_kept, col_kept))


def _spans(length: int, largest: int, radius: int, multiple: int) -> Iterator[tuple[slice, slice]]:
    """Windows of one size, at most `largest`, along one side, with what each keeps."""
    if length <= largest:
        yield slice(0, length), slice(0, length)
        return
    largest -= largest % multiple
    inner = length - 2 * radius  # the picture's own edges need no halo
    count = math.ceil(inner / (largest - 2 * radius))
    step = math.ceil(inner / count / multiple) * multiple
    count = math.ceil(inner / step)  # rounding the step up can make the last window needless
    size, done = step + 2 * radius, 0
    for index in range(count):
        start = min(index * step, length - size)
        stop = length if index == count - 1 else start + size - radius
        yield slice(start, start + size), slice(done, stop)
        done = stop


def padded(images: NDArray[np.float32], height: int, width: int, *, scale: int) -> tuple[NDArray[np.float32], Span]:
    """`(N, C, H, W)` with its edge pixels repeated around it up to `height x width`; the pictures themselves where they
    are that large. And where the picture's own part lies in a result `scale` times as large.
    """
    rows, cols = height - images.shape[2], width - images.shape[3]
    height, width = images.shape[2:]
    around = ((0, 0), (0, 0), (rows // 2, rows - rows // 2), (cols // 2, cols - cols // 2))
    kept = (
        slice(rows // 2 * scale, (rows // 2 + height) * scale),
        slice(cols // 2 * scale, (cols // 2 + width) * scale),
    )
    return (np.pad(images, around, mode="edge") if rows or cols else images), kept


def apply(
    run: Callable[[NDArray[np.float32]], NDArray[np.float32]],
    images: NDArray[np.float32],
    *,
    scale: int,
    radius: int,
    window: int,
    batch: int,
    multiple: int = 1,
) -> NDArray[np.float32]:
    """`run` over `(N, C, H, W)` in tiles of at most `window` input pixels; the result is a new array.

    Small pictures go several at a time, up to `batch` input pixels together. `run` takes `(n, C, h, w)` and gives
    `(n, C, scale*h, scale*w)`; `radius` is how far it sees, in input pixels, and `multiple` what the sides of a tile
    are multiples of where those of the pictures are.
    """
    count, channels, height, width = images.shape
    result = np.empty((count, channels, height * scale, width * scale), np.float32)
    together = max(1, batch // (height * width))
    for tile in split(height, width, radius=radius, window=window, multiple=multiple):
        span, source, target = tile.window, tile.source(scale), tile.target(scale)
        for first in range(0, count, together):
            part = slice(first, first + together)
            result[part, :, *target] = run(np.ascontiguousarray(images[part, :, *span]))[:, :, *source]
    return result
