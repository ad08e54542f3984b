"""What of a picture needs no network: where all that it would look at is one colour, the result is known before.

A network of convolutions makes of a picture of one colour the same pattern everywhere but near the border, as far in as
it sees. So a small picture of that colour tells what a large one becomes, and only boxes around what differs are
computed, with what they see. Rendered objects stand before one colour; and pictures of a set repeat one another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ciir.models.cards import Sizes
from ciir.models.tiles import Tile

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from numpy.typing import NDArray

    from ciir.models.cards import Card
    from ciir.models.tiles import Span

    Picture = NDArray[np.uint8] | NDArray[np.uint16]

LEAST = 3
"""Radius from which a model takes so long that it is worth looking for what needs none of it: networks do."""
WORTH = 0.95
"""Share of a picture's pixels in boxes above which the picture goes whole: what is won is lost in small steps."""
APART = 0.04
"""Share of a box's pixels that two boxes must save in its place."""
CALL = 1000
"""Pixels that take a network as long as one more call of it, roughly."""


class Model(Protocol):
    """A network, or what stands in for one."""

    @property
    def radius(self) -> int:
        """How many input pixels away, along each side, an input pixel can still change an output pixel."""
        ...


@dataclass
class SkipStatistics:
    """What was upscaled, input pixels."""

    pixels: int = 0
    """All of them."""
    uniform: int = 0
    """Those outside the boxes, all around of one colour."""
    repeated: int = 0
    """Those of pictures that were there before."""
    seconds: float = 0.0
    """What the others took; whoever calls the model adds it up."""


def suits(model: Model) -> bool:
    """Whether a model does the same all over a picture, and slowly enough for skipping to be worth it.

    Not one that has the sides of pictures made up to multiples, or to a square: its own border is not the picture's.
    """
    if model.radius < LEAST:
        return False
    card: Card | None = getattr(model, "card", None)  # interpolation has none
    sizes = Sizes(minimum=1) if card is None else card.sizes
    return sizes.multiple_of == 1 and not sizes.square and sizes.minimum <= 2 * model.radius + 1


def repeats(pictures: Picture) -> list[int]:
    """For each of `(N, H, W, C)` the number of the first that is equal to it, its own where there is none before."""
    first: dict[bytes, int] = {}
    return [first.setdefault(picture.tobytes(), number) for number, picture in enumerate(pictures)]


def found(picture: Picture, radius: int) -> tuple[Picture | None, list[Tile]]:
    """The colour `(C,)` around the object in a picture `(H, W, C)`, and the boxes of it that are to be computed; None
    and the whole picture where no box is worth it.
    """
    height, width, _ = picture.shape
    colour = around(picture) if min(height, width) > 2 * radius else None
    made = None if colour is None else boxes(differing(picture, colour), radius)
    everything = slice(0, height), slice(0, width)
    return (None, [Tile(everything, everything)]) if made is None else (colour, made)


def around(picture: Picture) -> Picture | None:
    """The colour `(C,)` that two corners or more of `(H, W, C)` have, most of them; None where all corners differ.

    Then no box is worth it: any that is smaller than the picture leaves one side out, and with it two corners.
    """
    corners = [picture[row, col] for row in (0, -1) for col in (0, -1)]
    same = [corner.tobytes() for corner in corners]
    most = max(range(4), key=lambda number: same.count(same[number]))
    return corners[most] if same.count(same[most]) > 1 else None


def differing(picture: Picture, colour: Picture) -> NDArray[np.bool_]:
    """`(H, W)`: where `(H, W, C)` is not of a colour `(C,)`."""
    found: NDArray[np.bool_] = picture[..., 0] != colour[0]
    for channel in range(1, picture.shape[2]):
        found |= picture[..., channel] != colour[channel]
    return found


def boxes(differs: NDArray[np.bool_], radius: int) -> list[Tile] | None:
    """What to compute of a picture for all that is within `radius` of where it `differs` `(H, W)` from one colour.

    None of it where it is that colour all over. None, for the whole, where boxes would be no smaller. What is kept of
    each box is `radius` wider than what differs, and what is read as much again; boxes may overlap.
    """
    height, width = differs.shape
    parts = _parts(differs, 2 * radius)
    made = [Tile(_grown(part, 2 * radius, differs.shape), _grown(part, radius, differs.shape)) for part in parts]
    return made if sum(area(tile.window) for tile in made) <= WORTH * height * width else None


def fill(result: NDArray[Any], pattern: NDArray[Any], radius: int, scale: int) -> None:
    """Makes `result` `(scale*H, scale*W, C)` what a picture of one colour becomes. `pattern`: what one of
    `2*radius + 1` pixels a side does, `(scale*(2*radius + 1), ..., C)`; H and W are as many at least.
    """
    edge = radius * scale
    height, width = result.shape[:2]
    left, middle, right = pattern[:, :edge], pattern[:, edge : edge + scale], pattern[:, edge + scale :]
    rows = np.concatenate([left, np.tile(middle, (1, width // scale - 2 * radius, 1)), right], axis=1)
    result[:edge], result[height - edge :] = rows[:edge], rows[edge + scale :]
    for phase in range(scale):
        result[edge + phase : height - edge : scale] = rows[edge + phase]


def area(part: Span) -> int:
    """Pixels."""
    rows, cols = part
    return int((rows.stop - rows.start) * (cols.stop - cols.start))


def _parts(differs: NDArray[np.bool_], halo: int, origin: tuple[int, int] = (0, 0)) -> list[Span]:
    """Boxes, without halo, around all that `differs`, which lies at `origin`: none, one, or two in its place and so on,
    where those save enough.
    """
    rows = np.flatnonzero(differs.any(axis=1))
    if not len(rows):
        return []
    cols = np.flatnonzero(differs[rows[0] : rows[-1] + 1].any(axis=0))
    (top, bottom), (left, right) = ((int(some[0]), int(some[-1]) + 1) for some in (rows, cols))
    inner, (down, across) = differs[top:bottom, left:right], (origin[0] + top, origin[1] + left)
    one = (bottom - top + 2 * halo) * (right - left + 2 * halo)
    saved = max(CALL, int(APART * one))
    is_full = inner.size - np.count_nonzero(inner) < saved
    two, at, axis = (one, 0, 0) if is_full else min((*_cut(inner, halo), 0), (*_cut(inner.T, halo), 1))
    if one - two < saved:
        return [(slice(down, down + bottom - top), slice(across, across + right - left))]
    if axis == 0:
        return _parts(inner[:at], halo, (down, across)) + _parts(inner[at:], halo, (down + at, across))
    return _parts(inner[:, :at], halo, (down, across)) + _parts(inner[:, at:], halo, (down, across + at))


def _cut(differs: NDArray[np.bool_], halo: int) -> tuple[int, int]:
    """Pixels of two boxes with their halos, one around the first rows of what `differs` and one around all others, for
    the best number of first rows; and that number.
    """
    height, width = differs.shape
    if height < 2:
        return (height + 2 * halo) * (width + 2 * halo), 0
    is_empty = ~differs.any(axis=1)
    left = np.where(is_empty, width, differs.argmax(axis=1))
    right = np.where(is_empty, 0, width - differs[:, ::-1].argmax(axis=1))
    above = np.maximum.accumulate(right) - np.minimum.accumulate(left)  # the width of what is in the rows up to each
    below = (np.maximum.accumulate(right[::-1]) - np.minimum.accumulate(left[::-1]))[::-1]
    first = np.arange(1, height)
    cost = (first + 2 * halo) * (above[:-1] + 2 * halo) + (height - first + 2 * halo) * (below[1:] + 2 * halo)
    best = int(cost.argmin())
    return int(cost[best]), best + 1


def _grown(part: Span, by: int, shape: Sequence[int]) -> Span:
    rows, cols = (
        slice(max(0, side.start - by), min(length, side.stop + by)) for side, length in zip(part, shape, strict=True)
    )
    return rows, cols
