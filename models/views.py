"""Views of a light field upscaled together: which others each one needs, and what comes out."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from models import shear
from models.errors import InvalidImage
from models.pixels import upscale_pixels
from models.session import BATCH, WINDOW
from models.tiles import split
from models.windows import axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from models.light_field import LightFieldNetwork
    from models.shear import Pixels
    from models.tiles import Span, Tile
    from models.upscaler import Upscaler
    from models.windows import Axis

    View = tuple[int, int]

TRUSTED, DOUBTED = 0.6, 0.75
"""Doubt up to which the light-field network's picture is taken, and from which the other's is. Views of one scene come
to 0.15 to 0.5 (Lego Knights, rendered meshes; nine tenths of all pixels), strange ones to 0.6 to 1."""
NEGLIGIBLE = 0.1
"""Share of a view's pixels in doubt that is left as it is: at silhouettes some always are."""
ROWS = 256
"""Rows of a picture that are blended at once."""


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

    That is where the views around don't match: another scene, noise, disparities that none of the network's planes has.
    Between `TRUSTED` and `DOUBTED` of its doubt one goes over into the other, in views of which more than `NEGLIGIBLE`
    is in doubt. Where the content of a view moves by more than a whole pixel to the next, views are first moved back by
    whole pixels (`models.shear`). What a view becomes does not depend on which others are wanted.

    `views`: (v, u) -> `(H, W, C)`, grey or RGB, 8 or 16 bit, all of one shape and type; at least those of `needed`.
    Grey comes back as the mean of three channels. The result is of the same type, rounded to nearest. Large views are
    made in tiles, of all views one place after the other: what is held beside input and result stays small.

    Raises `InvalidImage` where the views differ in shape or type, or have alpha or another number of channels.
    """
    first = _alike(views, wanted[0], needed(wanted, grid))
    height, width, channels = first.shape
    size = (height * network.scale, width * network.scale, channels)
    result = np.empty((len(wanted), *size), first.dtype)
    doubt = np.empty((len(wanted), height, width), np.float32)
    alike: dict[int, dict[int, View]] = {}
    for number, at in enumerate(wanted):
        alike.setdefault(shear.of(views, at, grid), {})[number] = at
    scale, peak = network.scale, np.float32(np.iinfo(first.dtype).max)
    for by, chosen in alike.items():
        for number, tile, picture, doubtful in _made(network, views, chosen, grid, by):
            grey = picture.mean(axis=2, keepdims=True) if channels == 1 else picture
            result[number][tile.target(scale)] = np.floor(grey * peak + np.float32(0.5))
            doubt[number][tile.kept] = doubtful
    left = 0.0
    for number, at in enumerate(wanted):
        strange = np.clip((doubt[number] - TRUSTED) / (DOUBTED - TRUSTED), 0, 1)
        if np.mean(strange > 0) > NEGLIGIBLE:
            _blend(result[number], _alone(alone, views[at]), strange)
            left += float(np.mean(strange > 0.5))
    return result, left / len(wanted)


def _made(
    network: LightFieldNetwork, views: Mapping[View, Pixels], chosen: Mapping[int, View], grid: tuple[int, int], by: int
) -> Iterator[tuple[int, Tile, NDArray[np.float32], NDArray[np.float32]]]:
    """Of each of the views `chosen`, under its number, and each tile: the picture `(scale*h, scale*w, 3)` in [0, 1] and
    the doubt `(h, w)`. The views around are moved by `by`.
    """
    scale, every = network.scale, needed(list(chosen.values()), grid)
    height, width = views[every[0]].shape[:2]
    for tile in split(height, width, radius=network.radius, window=WINDOW):
        lumas = {view: shear.luma(views[view], tile.window, by) for view in every}
        for rows, cols, numbers in _together(chosen, grid, most=max(1, BATCH // _pixels(tile.window))):
            image = np.stack([_colour(views[chosen[number]][tile.window]) for number in numbers])
            around = np.stack(
                [
                    [shear.moved(lumas[view], by, offset) for view, offset in _offsets(chosen[number], grid)]
                    for number in numbers
                ]
            )
            large, doubt = network(image, around, rows.there, cols.there)
            pictures = large[:, :, *tile.source(scale)].transpose(0, 2, 3, 1)
            for number, picture, doubtful in zip(numbers, pictures, doubt[:, 0, *tile.source(1)], strict=True):
                yield number, tile, picture, doubtful


def _alone(upscaler: Upscaler, view: Pixels) -> Pixels:
    # Its type variable takes 8 or 16 bit, where a view is either: one of them stands for both.
    made: Pixels = upscale_pixels(upscaler, cast("NDArray[np.uint8]", view[np.newaxis]))[0]
    return made


def _blend(picture: Pixels, other: Pixels, share: NDArray[np.float32]) -> None:
    """Puts `share` `(H, W)` of `other` into `picture`, both `(scale*H, scale*W, C)`."""
    scale = len(picture) // len(share)
    for first in range(0, len(share), ROWS):
        part = slice(first * scale, (first + ROWS) * scale)
        of = share[first : first + ROWS].repeat(scale, axis=0).repeat(scale, axis=1)[..., np.newaxis]
        mixed = (1 - of) * picture[part].astype(np.float32) + of * other[part].astype(np.float32)
        picture[part] = np.floor(mixed + np.float32(0.5))


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


def _together(
    chosen: Mapping[int, View], grid: tuple[int, int], *, most: int
) -> Iterator[tuple[Axis, Axis, list[int]]]:
    """The numbers of views whose windows stand alike, up to `most` at a time."""
    groups: dict[bytes, list[int]] = {}
    for number, (v, u) in chosen.items():
        key = axis(v, grid[0]).there.tobytes() + axis(u, grid[1]).there.tobytes()
        groups.setdefault(key, []).append(number)
    for numbers in groups.values():
        v, u = chosen[numbers[0]]
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
