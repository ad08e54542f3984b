"""Finds the parts of pictures that can be upscaled without the network: uniform background.

A convolutional network turns a picture of one colour into the same pattern everywhere, except within its receptive
field of the border. So a small picture of that colour gives the result for all uniform parts, and the network runs only
on boxes around everything else. Rendered objects have a uniform background.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.models.cards import Sizes
from ciir.models.tiles import Tile

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from numpy.typing import NDArray

    from ciir.models.cards import Card
    from ciir.models.sessions import OnnxNetwork
    from ciir.models.tiles import Span
    from ciir.models.upscaler import Upscaler

    Picture = NDArray[np.uint8] | NDArray[np.uint16]

MINIMUM_RADIUS = 3
"""Smallest radius of a model that is slow enough for skipping to save time. Networks are; interpolation isn't."""
MAXIMUM_SHARE = 0.95
"""If boxes hold a larger share of a picture's pixels, the whole picture is computed, which is then faster."""
SPLIT_SAVING = 0.04
"""The share of a box's pixels that splitting it in two must save."""
CALL_PIXELS = 1000
"""The number of pixels that a network computes in about the time that the overhead of one call takes."""


@dataclass
class SkipStatistics:
    """Counts of the input pixels that were upscaled and of those that were skipped."""

    pixels: int = 0
    """All pixels, skipped or not."""
    uniform: int = 0
    """Pixels skipped as uniform, because they are outside the boxes."""


def can_skip(model: Upscaler | OnnxNetwork) -> bool:
    """Returns whether skipping gives the same result and saves time.

    The result differs for a network whose pictures are padded to multiples or to a square, because the border that it
    sees is not the picture's.
    """
    if model.radius < MINIMUM_RADIUS:
        return False
    card: Card | None = getattr(model, "card", None)  # interpolation has none
    sizes = Sizes(minimum=1) if card is None else card.sizes
    return sizes.multiple_of == 1 and not sizes.square and sizes.minimum <= 2 * model.radius + 1


def find_boxes(picture: Picture, radius: int) -> tuple[Picture | None, list[Tile]]:
    """Returns the background colour `(C,)` of a picture `(H, W, C)` and the boxes around everything else, or None and
    the whole picture if boxes would save nothing.
    """
    height, width, _ = picture.shape
    colour = find_background(picture) if min(height, width) > 2 * radius else None
    boxes = None if colour is None else cover_with_boxes(find_differences(picture, colour), radius)
    whole = slice(0, height), slice(0, width)
    return (None, [Tile(whole, whole)]) if boxes is None else (colour, boxes)


def find_background(picture: Picture) -> Picture | None:
    """Returns the most frequent colour `(C,)` of the corners of `(H, W, C)`; None if all four differ.

    In that case boxes would save nothing: a box smaller than the picture leaves out at least one side, and with it two
    corners of equal colour.
    """
    corners = [picture[row, col] for row in (0, -1) for col in (0, -1)]
    values = [corner.tobytes() for corner in corners]
    best = max(range(4), key=lambda number: values.count(values[number]))
    return corners[best] if values.count(values[best]) > 1 else None


def find_differences(picture: Picture, colour: Picture) -> NDArray[np.bool_]:
    """Returns a mask `(H, W)` that is true where `(H, W, C)` differs from a colour `(C,)`."""
    differs: NDArray[np.bool_] = picture[..., 0] != colour[0]
    for channel in range(1, picture.shape[2]):
        differs |= picture[..., channel] != colour[channel]
    return differs


def cover_with_boxes(differs: NDArray[np.bool_], radius: int) -> list[Tile] | None:
    """Returns boxes that keep all pixels within `radius` of where a picture `differs` `(H, W)` from its background.

    The list is empty if it differs nowhere, and None is returned if boxes would save nothing. On each side a box keeps
    `radius` pixels more than the part that differs, and reads another `radius` pixels. Boxes may overlap.
    """
    height, width = differs.shape
    parts = split_differences(differs, 2 * radius)
    boxes = [
        Tile(_grow_span(part, 2 * radius, differs.shape), _grow_span(part, radius, differs.shape)) for part in parts
    ]
    return boxes if sum(count_pixels(box.region) for box in boxes) <= MAXIMUM_SHARE * height * width else None


def fill_with_pattern(result: NDArray[Any], pattern: NDArray[Any], radius: int, scale: int) -> None:
    """Sets `result` `(scale*H, scale*W, C)` to the network's result for a picture of one colour. H and W must be at
    least `2*radius + 1`. `pattern`: the result for a picture of that colour with sides of `2*radius + 1` pixels.
    """
    edge = radius * scale
    height, width = result.shape[:2]
    left, middle, right = pattern[:, :edge], pattern[:, edge : edge + scale], pattern[:, edge + scale :]
    rows = np.concatenate([left, np.tile(middle, (1, width // scale - 2 * radius, 1)), right], axis=1)
    result[:edge], result[height - edge :] = rows[:edge], rows[edge + scale :]
    for phase in range(scale):
        result[edge + phase : height - edge : scale] = rows[edge + phase]


def split_differences(differs: NDArray[np.bool_], halo: int, origin: tuple[int, int] = (0, 0)) -> list[Span]:
    """Returns boxes, without halo, around everything that `differs`, `(H, W)`; `origin` is its position in the picture.

    A box is replaced by two if that saves enough pixels, and each of these may be split again.
    """
    rows = np.flatnonzero(differs.any(axis=1))
    if not len(rows):
        return []
    cols = np.flatnonzero(differs[rows[0] : rows[-1] + 1].any(axis=0))
    (top, bottom), (left, right) = ((int(some[0]), int(some[-1]) + 1) for some in (rows, cols))
    inner, (down, across) = differs[top:bottom, left:right], (origin[0] + top, origin[1] + left)
    one = (bottom - top + 2 * halo) * (right - left + 2 * halo)
    saved = max(CALL_PIXELS, int(SPLIT_SAVING * one))
    is_full = inner.size - np.count_nonzero(inner) < saved
    two, cut, axis = (one, 0, 0) if is_full else min((*_find_cut(inner, halo), 0), (*_find_cut(inner.T, halo), 1))
    if one - two < saved:
        return [(slice(down, down + bottom - top), slice(across, across + right - left))]
    if axis == 0:
        parts = (inner[:cut], (down, across)), (inner[cut:], (down + cut, across))
    else:
        parts = (inner[:, :cut], (down, across)), (inner[:, cut:], (down, across + cut))
    return [span for part, place in parts for span in split_differences(part, halo, place)]


def count_pixels(part: Span) -> int:
    """Returns the number of pixels in a span of rows and columns."""
    rows, cols = part
    return int((rows.stop - rows.start) * (cols.stop - cols.start))


def _find_cut(differs: NDArray[np.bool_], halo: int) -> tuple[int, int]:
    """Finds the row at which to split so that the two boxes, around what `differs` above that row and from it on, have
    the fewest pixels with their halos. Returns that number of pixels and the row.
    """
    height, width = differs.shape
    if height < 2:
        return (height + 2 * halo) * (width + 2 * halo), 0
    is_empty = ~differs.any(axis=1)
    left = np.where(is_empty, width, differs.argmax(axis=1))
    right = np.where(is_empty, 0, width - differs[:, ::-1].argmax(axis=1))
    above = np.maximum.accumulate(right) - np.minimum.accumulate(left)  # width of the differences up to each row
    below = (np.maximum.accumulate(right[::-1]) - np.minimum.accumulate(left[::-1]))[::-1]
    first = np.arange(1, height)
    cost = (first + 2 * halo) * (above[:-1] + 2 * halo) + (height - first + 2 * halo) * (below[1:] + 2 * halo)
    best = int(cost.argmin())
    return int(cost[best]), best + 1


def _grow_span(part: Span, margin: int, shape: Sequence[int]) -> Span:
    rows, cols = (
        slice(max(0, side.start - margin), min(length, side.stop + margin))
        for side, length in zip(part, shape, strict=True)
    )
    return rows, cols
