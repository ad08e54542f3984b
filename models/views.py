"""Views of a light field upscaled together: which others each one needs, and what comes out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models import shear
from models.errors import InvalidImage
from models.session import BATCH, WINDOW
from models.tiles import split
from models.windows import axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from models.light_field import LightFieldNetwork
    from models.shear import Pixels
    from models.tiles import Span
    from models.upscaler import Upscaler
    from models.windows import Axis

    View = tuple[int, int]

TRUSTED, DOUBTED = 0.55, 0.7
"""Doubt up to which the light-field network's picture is taken, and from which the other's is. Views of one scene come
to 0.15 to 0.5 (Lego Knights, rendered meshes; nine tenths of all pixels), strange ones to 0.6 to 1."""
NEGLIGIBLE = 0.02
"""Share of pixels in doubt that is left as it is: at silhouettes some always are."""


def needed(wanted: Sequence[View], grid: tuple[int, int]) -> list[View]:
    """Every view (v, u) of the windows about `wanted`, in a grid of `grid` views, row by row and each once."""
    return sorted({view for at in wanted for view in _window(at, grid)})


def upscale_views(
    network: LightFieldNetwork,
    alone: Upscaler,
    views: Mapping[View, Pixels],
    wanted: Sequence[View],
    grid: tuple[int, int],
) -> tuple[Pixels, float]:
    """The views `wanted` of a light field of `grid` = (V, U) views, `(len(wanted), scale*H, scale*W, C)`; and the share
    of their pixels that `alone`, a model of single pictures, made for the most part.

    That is where the views around don't match: another scene, too large disparities, noise. Between `TRUSTED` and
    `DOUBTED` of the network's doubt one goes over into the other. Where content moves by more whole pixels from view to
    view than the network looks for, the views are first moved back by those (`models.shear`).

    `views`: (v, u) -> `(H, W, C)`, grey or RGB, 8 or 16 bit, all of one shape and type; at least those of `needed`.
    Grey comes back as the mean of three channels. The result is of the same type, rounded to nearest. Large views are
    made in tiles, of all views one place after the other: what is held beside input and result stays small.

    Raises `InvalidImage` where the views differ in shape or type, or have alpha or another number of channels.
    """
    every = needed(wanted, grid)
    first = _alike(views, wanted[0], every)
    scale, peak = network.scale, np.float32(np.iinfo(first.dtype).max)
    height, width, channels = first.shape
    by = shear.of(views, wanted[0], grid)
    result = np.empty((len(wanted), height * scale, width * scale, channels), first.dtype)
    left = 0.0
    for tile in split(height, width, radius=network.radius, window=WINDOW):
        source, target = tile.source(scale), tile.target(scale)
        lumas = {view: shear.luma(views[view], tile.window, by) for view in every}
        for rows, cols, numbers in _together(wanted, grid, most=max(1, BATCH // _pixels(tile.window))):
            image = np.stack([_colour(views[wanted[number]][tile.window]) for number in numbers])
            around = np.stack(
                [
                    [shear.moved(lumas[view], by, offset) for view, offset in _offsets(wanted[number], grid)]
                    for number in numbers
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


def _alike(views: Mapping[View, Pixels], one: View, every: Sequence[View]) -> Pixels:
    """View `one`, once it is known to be a picture and the others to be like it."""
    first = views[one]
    if first.ndim != 3 or first.shape[2] not in (1, 3) or first.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(
            f"views of shape {first.shape} and {first.dtype}: give (H, W, C), grey or RGB, of 8 or 16 bit"
        )
    for v, u in every:
        other = views[v, u]
        if other.shape != first.shape or other.dtype != first.dtype:
            raise InvalidImage(
                f"view {v},{u}: {other.shape} of {other.dtype}, where view {one[0]},{one[1]} is {first.shape} of "
                f"{first.dtype}; give views of one size and depth"
            )
    return first


def _together(wanted: Sequence[View], grid: tuple[int, int], *, most: int) -> Iterator[tuple[Axis, Axis, list[int]]]:
    """The numbers of views whose windows stand alike, up to `most` at a time."""
    groups: dict[bytes, list[int]] = {}
    for number, (v, u) in enumerate(wanted):
        key = axis(v, grid[0]).place.tobytes() + axis(u, grid[1]).place.tobytes()
        groups.setdefault(key, []).append(number)
    for numbers in groups.values():
        v, u = wanted[numbers[0]]
        for begin in range(0, len(numbers), most):
            yield axis(v, grid[0]), axis(u, grid[1]), numbers[begin : begin + most]


def _window(at: View, grid: tuple[int, int]) -> list[View]:
    """The views of the window about one, row by row."""
    rows, cols = axis(at[0], grid[0]), axis(at[1], grid[1])
    return [(row, col) for row in rows.views for col in cols.views]


def _offsets(at: View, grid: tuple[int, int]) -> list[tuple[View, View]]:
    """Each view of the window about one, and how far down and to the right of it it is."""
    return [(view, (view[0] - at[0], view[1] - at[1])) for view in _window(at, grid)]


def _pixels(part: Span) -> int:
    rows, cols = part
    return int((rows.stop - rows.start) * (cols.stop - cols.start))


def _colour(picture: Pixels) -> NDArray[np.float32]:
    """`(H, W, 1 or 3)` -> `(3, H, W)` in [0, 1]."""
    return np.broadcast_to(shear.as_float(picture), (*picture.shape[:2], 3)).transpose(2, 0, 1)
