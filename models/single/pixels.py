"""Upscales integer pictures: grey, colour and alpha, 8 and 16 bit."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ciir.bit_depth import count_raised_bits, lower_levels, raise_levels
from ciir.errors import InvalidImage
from ciir.models import tiles
from ciir.models.back_projection import reduce_neighbours
from ciir.models.single import skipping
from ciir.models.single.skipping import SkipStatistics

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from ciir.models.tiles import Tile
    from ciir.models.upscaler import Upscaler

BLOCK_PIXELS = 1 << 20
"""Most input pixels held as float at once: 12 MiB, and `scale**2` times as much output, for each pass."""


def upscale_pixels(
    upscaler: Upscaler,
    pictures: NDArray[Any],
    *,
    skip: bool = True,
    statistics: SkipStatistics | None = None,
    keeps_fractions: bool = False,
) -> NDArray[Any]:
    """Upscales `(N, H, W, C)` to `(N, scale*H, scale*W, C)` of the same type, rounded to nearest.

    C is 1 for grey, 2 for grey and alpha, 3 for RGB, and 4 for RGB and alpha; 8 or 16 bit. Grey is upscaled as three
    equal channels, whose mean is returned. Alpha is straight: colours are multiplied by it before their pass and
    divided by it afterwards, so that hidden colours don't bleed into visible ones. Alpha has its own pass and is exact
    where it was flat: where a pixel and its eight neighbours are all clear or all opaque, so is the result. Clear
    pixels come out black.

    For a network, 16-bit colours that use fewer bits, and dark 8-bit ones, are multiplied by a power of two beforehand
    and divided by it afterwards (`ciir.bit_depth`). `skip`: whether to skip uniform parts
    (`models.single.skipping`), which doesn't change the result. `statistics`: the counts that the pixels are added to.
    `keeps_fractions`: whether 8-bit pictures come out in 16 bits, with 257 times the levels, because they are rounded
    later.

    Raises `InvalidImage` if the array has another shape or type.
    """
    if pictures.ndim != 4 or not 1 <= pictures.shape[3] <= 4 or 0 in pictures.shape[1:3]:
        raise InvalidImage(f"an array of shape {pictures.shape}: give (N, H, W, C) with C from 1 to 4")
    if pictures.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(f"pictures of type {pictures.dtype}: give 8 or 16 bit unsigned integers")
    is_network = hasattr(upscaler, "card")  # interpolation has none, and is the same at all levels
    unused = [count_raised_bits(picture) if is_network else 0 for picture in pictures]
    if any(unused):
        pictures = np.stack([raise_levels(picture, bits) for picture, bits in zip(pictures, unused, strict=True)])
    depth = np.dtype(np.uint16) if keeps_fractions else pictures.dtype
    statistics = SkipStatistics() if statistics is None else statistics
    count, height, width, _ = pictures.shape
    statistics.pixels += count * height * width
    large = _upscale_boxes(upscaler, pictures, depth, statistics) if skip else _upscale_whole(upscaler, pictures, depth)
    for picture, bits in zip(large, unused, strict=True):
        lower_levels(picture, bits)
    return large


def _upscale_boxes(
    upscaler: Upscaler, pictures: NDArray[Any], depth: np.dtype[Any], statistics: SkipStatistics
) -> NDArray[Any]:
    """Upscales pictures, and computes only the parts that are not uniform background."""
    count, height, width, channels = pictures.shape
    scale, radius = upscaler.scale, upscaler.radius
    found = [skipping.find_boxes(picture, radius) for picture in pictures] if skipping.can_skip(upscaler) else []
    if all(colour is None for colour, _ in found):
        return _upscale_whole(upscaler, pictures, depth)
    result = np.empty((count, height * scale, width * scale, channels), depth)
    by_shape: dict[tuple[int, ...], list[tuple[int, Tile]]] = {}
    for number, (colour, boxes) in enumerate(found):
        if colour is not None:
            pattern = _make_pattern(cast("Any", upscaler), colour.tobytes(), pictures.dtype, depth)
            skipping.fill_with_pattern(result[number], pattern, radius, scale)
            computed = sum(skipping.count_pixels(box.region) for box in boxes)
            statistics.uniform += max(0, height * width - computed)
        for box in boxes:
            by_shape.setdefault(pictures[number][box.region].shape, []).append((number, box))
    for group in by_shape.values():
        parts = np.stack([pictures[number][box.region] for number, box in group])
        for (number, box), large in zip(group, _upscale_whole(upscaler, parts, depth), strict=True):
            result[number][box.kept_in_picture(scale)] = large[box.kept_in_tile(scale)]
    return result


@lru_cache(maxsize=64)
def _make_pattern(upscaler: Any, colour: bytes, given: np.dtype[Any], depth: np.dtype[Any]) -> NDArray[Any]:
    """Returns the result for a small picture of one colour, as `skipping.fill_with_pattern` takes it."""
    side = 2 * upscaler.radius + 1
    uniform = np.tile(np.frombuffer(colour, given), (1, side, side, 1))
    pattern: NDArray[Any] = _upscale_whole(upscaler, uniform, depth)[0]
    return pattern


def _upscale_whole(upscaler: Upscaler, pictures: NDArray[Any], depth: np.dtype[Any]) -> NDArray[Any]:
    """Upscales pictures without skipping."""
    count, height, width, channels = pictures.shape
    scale = upscaler.scale
    result = np.empty((count, height * scale, width * scale, channels), depth)
    batch = max(1, BLOCK_PIXELS // (height * width))
    for tile in tiles.split_picture(height, width, radius=max(1, upscaler.radius), tile_pixels=BLOCK_PIXELS):
        (rows, cols), (top, left) = tile.region, tile.kept_in_picture(scale)
        good_rows, good_cols = tile.kept_in_tile(scale)
        for first in range(0, count, batch):
            part = slice(first, first + batch)
            large = _upscale_block(upscaler, pictures[part, rows, cols], depth)  # (n, C, h, w)
            for channel in range(channels):  # several times faster than all at once
                result[part, top, left, channel] = large[:, channel, good_rows, good_cols]
    return result


def _upscale_block(upscaler: Upscaler, pictures: NDArray[Any], depth: np.dtype[Any]) -> NDArray[Any]:
    """Upscales `(n, h, w, C)` to `(n, C, scale*h, scale*w)` of the type `depth`."""
    peak = np.float32(np.iinfo(pictures.dtype).max)
    planes = np.moveaxis(pictures, 3, 1).astype(np.float32, order="C")  # (N, C, H, W)
    planes /= peak
    has_alpha = pictures.shape[3] in (2, 4)
    colour = planes[:, :-1] if has_alpha else planes
    if not has_alpha or (planes[:, -1:] == 1.0).all():
        large = _upscale_colour(upscaler, colour)
        if has_alpha:
            large = np.concatenate((large, np.ones_like(large[:, :1])), axis=1)
    else:
        alpha = planes[:, -1:]
        large_alpha = _upscale_alpha(upscaler, alpha)
        large_colour = _upscale_colour(upscaler, colour * alpha)
        large_colour /= np.maximum(large_alpha, 0.5 / peak)
        large_colour *= large_alpha > 0
        np.minimum(large_colour, 1.0, out=large_colour)
        large = np.concatenate((large_colour, large_alpha), axis=1)
    large *= np.iinfo(depth).max
    large += 0.5
    return large.astype(depth)


def _upscale_colour(upscaler: Upscaler, colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """Upscales `(N, 1 or 3, H, W)` to the same number of channels."""
    if colour.shape[1] == 3:
        return upscaler(np.ascontiguousarray(colour))
    return np.asarray(upscaler(np.repeat(colour, 3, axis=1)).mean(axis=1, keepdims=True))


def _upscale_alpha(upscaler: Upscaler, alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """Upscales `(N, 1, H, W)`. The result is exactly 0 or 1 where all of the surrounding 3x3 pixels are."""
    large = _upscale_colour(upscaler, alpha)
    for value, by in ((0.0, np.maximum), (1.0, np.minimum)):
        flat = reduce_neighbours(reduce_neighbours(alpha, 2, by), 3, by) == value
        large[flat.repeat(upscaler.scale, axis=2).repeat(upscaler.scale, axis=3)] = value
    return large
