"""Batches: parts of views that a light-field network upscales in one run."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ciir.models.light_field.windows import select_axis
from ciir.models.sessions import BATCH_PIXELS
from ciir.models.single.skipping import count_pixels

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from ciir.models.light_field.planes import Range
    from ciir.models.light_field.windows import Axis, View
    from ciir.models.tiles import Tile


class Part(NamedTuple):
    """A part of a view that is upscaled in one run."""

    number: int
    """The view's number."""
    tile: Tile
    mask: NDArray[np.bool_] | None = None
    """Which of the pixels that `tile` keeps are written, `(h, w)`; None for all of them."""


class Batch(NamedTuple):
    """Parts of one size that are upscaled in one run."""

    rows: Axis
    cols: Axis
    """`rows` and `cols` are those of the parts' windows, which all have the same."""
    disparities: Range
    parts: Sequence[Part]


def make_batches(
    parts: Sequence[Part], wanted: Sequence[View], grid: tuple[int, int], ranges: Sequence[Range]
) -> Iterator[Batch]:
    """Yields batches of up to `BATCH_PIXELS` pixels. All parts of a batch have one size, and their views' windows have
    the same rows and columns present and the same range of disparities. `wanted`, `ranges`: by the views' numbers.
    """
    alike: dict[tuple[object, ...], list[Part]] = {}
    for part in parts:
        v, u = wanted[part.number]
        present = select_axis(v, grid[0]).present.tobytes() + select_axis(u, grid[1]).present.tobytes()
        rows, cols = part.tile.region
        size = rows.stop - rows.start, cols.stop - cols.start
        alike.setdefault((present, ranges[part.number], *size), []).append(part)
    for some in alike.values():
        v, u = wanted[some[0].number]
        window = select_axis(v, grid[0]), select_axis(u, grid[1])
        count = max(1, BATCH_PIXELS // count_pixels(some[0].tile.region))
        for begin in range(0, len(some), count):
            yield Batch(*window, ranges[some[0].number], some[begin : begin + count])
