"""Tiles of a picture: regions with a halo of at least the receptive field, so that tiling doesn't change the result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ciir.models.parallel import is_parallel_faster, run_each

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

Span = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Tile:
    """A region of a picture, and the part whose result is kept."""

    region: Span
    """The part that is read, including the halo, in input pixels."""
    kept: Span
    """The part whose result is kept, in input pixels. The kept parts of all tiles cover the picture exactly once."""

    def clip_to(self, outer: Tile) -> Tile:
        """Converts this tile from coordinates of the region of `outer` to the picture's, and keeps at most its part."""
        region, kept = [], []
        for side, good, around, limit in zip(self.region, self.kept, outer.region, outer.kept, strict=True):
            region.append(_scale_slice(side, 1, origin=-around.start))
            start = min(max(good.start + around.start, limit.start), limit.stop)
            kept.append(slice(start, max(start, min(good.stop + around.start, limit.stop))))
        return Tile((region[0], region[1]), (kept[0], kept[1]))

    def region_in(self, outer: Span) -> Span:
        """Returns the region in coordinates of a part of the picture that contains it."""
        rows, cols = (
            _scale_slice(side, 1, origin=around.start) for side, around in zip(self.region, outer, strict=True)
        )
        return rows, cols

    def kept_in_tile(self, scale: int) -> Span:
        """Returns the kept part within the result of the region, in output pixels."""
        rows, cols = (
            _scale_slice(good, scale, origin=side.start) for good, side in zip(self.kept, self.region, strict=True)
        )
        return rows, cols

    def kept_in_picture(self, scale: int) -> Span:
        """Returns the kept part within the result of the picture, in output pixels."""
        rows, cols = (_scale_slice(good, scale, origin=0) for good in self.kept)
        return rows, cols


def _scale_slice(span: slice, scale: int, *, origin: int) -> slice:
    return slice((span.start - origin) * scale, (span.stop - origin) * scale)


def split_picture(height: int, width: int, *, radius: int, tile_pixels: int, multiple: int = 1) -> Iterator[Tile]:
    """Yields tiles of at most `tile_pixels` pixels that cover a picture of `height x width`, row by row.

    Each has a halo of `radius` pixels along every edge that is not the picture's own. All tiles of a picture have the
    same size, so that a runtime plans for one shape. If the picture's sides are multiples of `multiple`, so are the
    sides and positions of all tiles.

    Raises `ValueError` if a square of `tile_pixels` pixels is all halo.
    """
    radius = math.ceil(radius / multiple) * multiple
    side = math.isqrt(tile_pixels) // multiple * multiple
    if side <= 2 * radius:
        raise ValueError(
            f"a tile of {tile_pixels} pixels has nothing inside a halo of {radius}; give over {4 * radius**2}"
        )
    if height <= side:
        rows, cols = height, tile_pixels // height
    elif width <= side:
        rows, cols = tile_pixels // width, width
    else:
        rows, cols = side, side
    for row_region, row_kept in _split_side(height, rows, radius, multiple):
        for col_region, col_kept in _split_side(width, cols, radius, multiple):
            yield Tile((row_region, col_region), (row_kept, col_kept))


def _split_side(length: int, largest: int, radius: int, multiple: int) -> Iterator[tuple[slice, slice]]:
    """Yields regions of one size, at most `largest`, along one side, with the part of each that is kept."""
    if length <= largest:
        yield slice(0, length), slice(0, length)
        return
    largest -= largest % multiple
    inner = length - 2 * radius  # the picture's own edges need no halo
    count = math.ceil(inner / (largest - 2 * radius))
    step = math.ceil(inner / count / multiple) * multiple
    count = math.ceil(inner / step)  # rounding the step up can make the last region superfluous
    size, done = step + 2 * radius, 0
    for index in range(count):
        start = min(index * step, length - size)
        stop = length if index == count - 1 else start + size - radius
        yield slice(start, start + size), slice(done, stop)
        done = stop


def pad_pictures(
    images: NDArray[np.float32], height: int, width: int, *, scale: int
) -> tuple[NDArray[np.float32], Span]:
    """Pads `(N, C, H, W)` with its edge pixels to at least `height x width`; pictures of that size are not copied.

    Also returns which part of a result `scale` times as large belongs to the pictures themselves.
    """
    rows, cols = height - images.shape[2], width - images.shape[3]
    height, width = images.shape[2:]
    padding = ((0, 0), (0, 0), (rows // 2, rows - rows // 2), (cols // 2, cols - cols // 2))
    kept = (
        slice(rows // 2 * scale, (rows // 2 + height) * scale),
        slice(cols // 2 * scale, (cols // 2 + width) * scale),
    )
    return (np.pad(images, padding, mode="edge") if rows or cols else images), kept


def run_in_tiles(
    run: Callable[[NDArray[np.float32], int], NDArray[np.float32]],
    images: NDArray[np.float32],
    *,
    scale: int,
    radius: int,
    tile_pixels: int,
    batch_pixels: int,
    multiple: int = 1,
    cores: int = 1,
    at_once: bool = False,
) -> NDArray[np.float32]:
    """Calls `run` on `(N, C, H, W)` in tiles and returns `(N, C, scale*H, scale*W)`, a new array.

    `run` takes `(n, C, h, w)` and a number of cores, and returns `(n, C, scale*h, scale*w)`. `radius` is its receptive
    field radius, in input pixels. A tile has at most `tile_pixels` input pixels, with sides as in `split_picture`.
    Small pictures are run in batches of up to `batch_pixels` input pixels. Calls run one after the other on all
    `cores`; with `at_once` many can run in parallel, each on one core.
    """
    count, channels, height, width = images.shape
    result = np.empty((count, channels, height * scale, width * scale), np.float32)
    batch = max(1, batch_pixels // (height * width))
    parts = [slice(first, first + batch) for first in range(0, count, batch)]
    tiles = split_picture(height, width, radius=radius, tile_pixels=tile_pixels, multiple=multiple)
    calls = list(product(tiles, parts))
    is_parallel = at_once and is_parallel_faster(len(calls), cores)

    def upscale(call: tuple[Tile, slice]) -> None:
        tile, part = call
        large = run(np.ascontiguousarray(images[part, :, *tile.region]), 1 if is_parallel else cores)
        result[part, :, *tile.kept_in_picture(scale)] = large[:, :, *tile.kept_in_tile(scale)]

    run_each(upscale, calls, cores if is_parallel else 1)
    return result
