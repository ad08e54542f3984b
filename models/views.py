"""Views of a light field upscaled together: which others each one needs, and what comes out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.errors import InvalidImage
from models.light_field import luma
from models.session import BATCH, WINDOW
from models.tiles import split
from models.windows import axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from models.light_field import LightFieldNetwork
    from models.tiles import Span
    from models.upscaler import Upscaler
    from models.windows import Axis

    View = tuple[int, int]
    Pixels = NDArray[np.uint8] | NDArray[np.uint16]


TRUSTED, DOUBTED = 0.55, 0.7
"""Doubt up to which the light-field network's picture is taken, and from which the other's is. Views of one scene come
to 0.15 to 0.5 (Lego Knights, rendered meshes; nine tenths of all pixels), strange ones to 0.6 to 1."""
NEGLIGIBLE = 0.02
"""Share of pixels in doubt that is left as it is: at silhouettes some always are."""


def needed(wanted: Sequence[View], grid: tuple[int, int]) -> list[View]:
    """Every view (v, u) of the windows about `wanted`, in a grid of `grid` views, row by row and each once."""
    found = {
        (row, col) for v, u in wanted for row in axis(v, grid[0]).views for col in axis(u, grid[1]).views
    }  # a window's missing rows and columns repeat the view's own
    return sorted(found)


def upscale_views(
    network: LightFieldNetwork,
    alone: Upscaler,
    views: Mapping[View, Pixels],
    wanted: Sequence[View],
    grid: tuple[int, int],
) -> tuple[Pixels, float]:
    """The views `wanted` of a light field of `grid` = (V, U) views, `(len(wanted), scale*H, scale*W, C)`; and the share
    of their pixels that `alone`, a model of single pictures, made for the most part.

    That is where the views around don't match: another scene, disparities beyond the network's, noise. Between
    `TRUSTED` and `DOUBTED` of the network's doubt one goes over into the other.

    `views`: (v, u) -> `(H, W, C)`, grey or RGB, 8 or 16 bit, all of one shape and type; at least those of `needed`.
    Grey comes back as the mean of three channels. The result is of the same type, rounded to nearest. Large views are
    made in tiles, of all views one place after the other: what is held beside input and result stays small.

    Raises `InvalidImage` where the views differ in shape or type, or have alpha or another number of channels.
    """
    first = views[wanted[0]]
    _check(first)
    every = needed(wanted, grid)
    for view in every:
        if views[view].shape != first.shape or views[view].dtype != first.dtype:
            raise InvalidImage(
                f"view {view[0]},{view[1]}: {views[view].shape} of {views[view].dtype}, where view {wanted[0][0]},"
                f"{wanted[0][1]} is {first.shape} of {first.dtype}; give views of one size and depth"
            )
    scale, peak = network.scale, np.float32(np.iinfo(first.dtype).max)
    height, width, channels = first.shape
    left = 0.0
    result = np.empty((len(wanted), height * scale, width * scale, channels), first.dtype)
    for tile in split(height, width, radius=network.radius, window=WINDOW):
        source, target = tile.source(scale), tile.target(scale)
        parts = {view: views[view][tile.window].astype(np.float32) / peak for view in every}
        lumas = {view: np.clip(luma(part), 0, 1) for view, part in parts.items()}
        together = max(1, BATCH // lumas[wanted[0]].size)
        for rows, cols, numbers in _alike(wanted, grid, together=together):
            image = np.stack([_colour(parts[wanted[number]]) for number in numbers])
            around = np.stack(
                [
                    [lumas[row, col] for row in axis(v, grid[0]).views for col in axis(u, grid[1]).views]
                    for v, u in (wanted[number] for number in numbers)
                ]
            )
            large, doubt = network(image, around, rows.place, cols.place)
            strange = np.clip((doubt - TRUSTED) / (DOUBTED - TRUSTED), 0, 1)
            if np.mean(strange > 0) > NEGLIGIBLE:
                share = strange.repeat(scale, axis=2).repeat(scale, axis=3)
                large = (1 - share) * large + share * alone(image)
                left += float(np.mean(strange[:, :, *tile.source(1)] > 0.5)) * len(numbers) * _pixels(tile.kept)
            large = large[:, :, *source].transpose(0, 2, 3, 1)
            if channels == 1:
                large = large.mean(axis=3, keepdims=True)
            for number, picture in zip(numbers, large, strict=True):
                result[number][target] = np.floor(picture * peak + np.float32(0.5)).astype(first.dtype)
    return result, left / (len(wanted) * height * width)


def _pixels(part: Span) -> int:
    rows, cols = part
    return int((rows.stop - rows.start) * (cols.stop - cols.start))


def _alike(wanted: Sequence[View], grid: tuple[int, int], *, together: int) -> Iterator[tuple[Axis, Axis, list[int]]]:
    """The numbers of views whose windows stand alike, up to `together` at a time."""
    groups: dict[bytes, list[int]] = {}
    for number, (v, u) in enumerate(wanted):
        key = axis(v, grid[0]).place.tobytes() + axis(u, grid[1]).place.tobytes()
        groups.setdefault(key, []).append(number)
    for numbers in groups.values():
        v, u = wanted[numbers[0]]
        for begin in range(0, len(numbers), together):
            yield axis(v, grid[0]), axis(u, grid[1]), numbers[begin : begin + together]


def _colour(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """`(H, W, 1 or 3)` -> `(3, H, W)`."""
    return np.broadcast_to(picture, (*picture.shape[:2], 3)).transpose(2, 0, 1)


def _check(picture: Pixels) -> None:
    if picture.ndim != 3 or picture.shape[2] not in (1, 3) or picture.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(
            f"views of shape {picture.shape} and {picture.dtype}: give (H, W, C), grey or RGB, of 8 or 16 bit"
        )
