"""Integer pictures through an upscaler: grey, colour and alpha, 8 and 16 bit."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np

from ciir.errors import InvalidImage
from ciir.models import tiles
from ciir.models.single import skipping
from ciir.models.single.skipping import SkipStatistics

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from ciir.models.tiles import Tile
    from ciir.models.upscaler import Upscaler

Depth = TypeVar("Depth", np.uint8, np.uint16)

BLOCK = 1 << 20
"""Most input pixels held as float at once: 12 MiB, and `scale**2` times that of output, for each pass."""


def upscale_pixels(
    upscaler: Upscaler, pictures: NDArray[Depth], *, skip: bool = True, statistics: SkipStatistics | None = None
) -> NDArray[Depth]:
    """`(N, H, W, C)` -> `(N, scale*H, scale*W, C)` of the same type, rounded to nearest.

    C: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha; 8 or 16 bit. Grey goes through as three equal channels and
    the mean comes back. Alpha is straight: colours are multiplied by it before their pass and divided after, so that
    what is hidden doesn't bleed into what shows, and alpha has a pass of its own. Alpha is exact where it was flat:
    where a pixel and its eight neighbours are all clear or all opaque, so is the result. Clear pixels come out black.

    `skip`: whether to leave out what `models.single.skipping` finds, which doesn't change the result; what was
    skipped is
    added to `statistics`.

    Raises `InvalidImage` where the array is of another shape or type.
    """
    if pictures.ndim != 4 or not 1 <= pictures.shape[3] <= 4 or 0 in pictures.shape[1:3]:
        raise InvalidImage(f"an array of shape {pictures.shape}: give (N, H, W, C) with C from 1 to 4")
    if pictures.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(f"pictures of type {pictures.dtype}: give 8 or 16 bit unsigned integers")
    statistics = SkipStatistics() if statistics is None else statistics
    count, height, width, _ = pictures.shape
    statistics.pixels += count * height * width
    if not skip:
        return _whole(upscaler, pictures)
    firsts = skipping.repeats(pictures) if count > 1 else [0] * count
    singles = sorted(set(firsts))
    if len(singles) == count:
        return _boxed(upscaler, pictures, statistics)
    statistics.repeated += (count - len(singles)) * height * width
    made = _boxed(upscaler, pictures[singles], statistics)
    return made[np.searchsorted(singles, firsts)]


def _boxed(upscaler: Upscaler, pictures: NDArray[Depth], statistics: SkipStatistics) -> NDArray[Depth]:
    """All of them, but only what is not one colour all around is computed."""
    count, height, width, channels = pictures.shape
    scale, radius = upscaler.scale, upscaler.radius
    found = [skipping.found(picture, radius) for picture in pictures] if skipping.suits(upscaler) else []
    if all(colour is None for colour, _ in found):
        return _whole(upscaler, pictures)
    result = np.empty((count, height * scale, width * scale, channels), pictures.dtype)
    alike: dict[tuple[int, ...], list[tuple[int, Tile]]] = {}
    for number, (colour, boxes) in enumerate(found):
        if colour is not None:
            pattern = _pattern(cast("Any", upscaler), colour.tobytes(), pictures.dtype.name)
            skipping.fill(result[number], pattern, radius, scale)
            statistics.uniform += max(0, height * width - sum(skipping.area(box.window) for box in boxes))
        for box in boxes:
            alike.setdefault(pictures[number][box.window].shape, []).append((number, box))
    for some in alike.values():
        parts = np.stack([pictures[at][part.window] for at, part in some])
        for (at, part), large in zip(some, _whole(upscaler, parts), strict=True):
            result[at][part.target(scale)] = large[part.source(scale)]
    return result


@lru_cache(maxsize=64)
def _pattern(upscaler: Any, colour: bytes, dtype: str) -> NDArray[Any]:
    """What a picture of one colour becomes, as `skipping.fill` takes it."""
    side = 2 * upscaler.radius + 1
    one = np.frombuffer(colour, dtype)
    made: NDArray[Any] = _whole(upscaler, np.tile(one, (1, side, side, 1)))[0]
    return made


def _whole(upscaler: Upscaler, pictures: NDArray[Depth]) -> NDArray[Depth]:
    """`upscale_pixels`, everything computed."""
    count, height, width, channels = pictures.shape
    scale = upscaler.scale
    result = np.empty((count, height * scale, width * scale, channels), pictures.dtype)
    together = max(1, BLOCK // (height * width))
    for tile in tiles.split(height, width, radius=max(1, upscaler.radius), window=BLOCK):
        rows, cols = tile.window
        source, target = tile.source(scale), tile.target(scale)
        for first in range(0, count, together):
            part = slice(first, first + together)
            large = _block(upscaler, pictures[part, rows, cols])
            result[part, target[0], target[1]] = large[:, source[0], source[1]]
    return result


def _block(upscaler: Upscaler, pictures: NDArray[Depth]) -> NDArray[Depth]:
    peak = np.float32(np.iinfo(pictures.dtype).max)
    planes = np.moveaxis(pictures, 3, 1).astype(np.float32)  # (N, C, H, W)
    planes /= peak
    has_alpha = pictures.shape[3] in (2, 4)
    colour = planes[:, :-1] if has_alpha else planes
    if not has_alpha or (planes[:, -1:] == 1.0).all():
        large = _colour(upscaler, colour)
        if has_alpha:
            large = np.concatenate((large, np.ones_like(large[:, :1])), axis=1)
    else:
        alpha = planes[:, -1:]
        large_alpha = _alpha(upscaler, alpha)
        large_colour = _colour(upscaler, colour * alpha)
        large_colour /= np.maximum(large_alpha, 0.5 / peak)
        large_colour *= large_alpha > 0
        np.minimum(large_colour, 1.0, out=large_colour)
        large = np.concatenate((large_colour, large_alpha), axis=1)
    large *= peak
    large += 0.5
    return np.moveaxis(large.astype(pictures.dtype), 1, 3)


def _colour(upscaler: Upscaler, colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """`(N, 1 or 3, H, W)` -> the same channels, `scale` times as large."""
    if colour.shape[1] == 3:
        return upscaler(np.ascontiguousarray(colour))
    return np.asarray(upscaler(np.repeat(colour, 3, axis=1)).mean(axis=1, keepdims=True))


def _alpha(upscaler: Upscaler, alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """`(N, 1, H, W)` -> `scale` times as large; exactly 0 or 1 where the 3x3 pixels around are."""
    large = _colour(upscaler, alpha)
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(alpha, ((0, 0), (0, 0), (1, 1), (1, 1)), mode="edge"), (3, 3), axis=(2, 3)
    )  # (N, 1, H, W, 3, 3)
    for value, flat in ((0.0, windows.max(axis=(4, 5)) == 0.0), (1.0, windows.min(axis=(4, 5)) == 1.0)):
        large[flat.repeat(upscaler.scale, axis=2).repeat(upscaler.scale, axis=3)] = value
    return large
