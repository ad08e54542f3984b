"""What of a light field's views needs no network: where a view and all those around it are one colour
(`models.single.skipping`),
and views whose windows repeat.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.models.light_field import disparity
from ciir.models.light_field.windows import WINDOW_SIDE, list_window, select_axis
from ciir.models.single import skipping

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.disparity import Pixels
    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.single.skipping import SkipStatistics
    from ciir.models.tiles import Tile

    View = tuple[int, int]


def colour(network: LightFieldNetwork, view: Pixels) -> Pixels | None:
    """What is around the object in a view `(H, W, C)`; None where nothing is won by it."""
    if min(view.shape[:2]) <= 2 * network.radius or not skipping.suits(network):
        return None
    return skipping.around(view)


def repeats(views: Mapping[View, Pixels], wanted: Sequence[View], grid: tuple[int, int]) -> list[int]:
    """For each view of `wanted` the number of the first whose window is equal, its own where there is none before."""
    kinds: dict[bytes, int] = {}
    kind: dict[View, int] = {}
    first: dict[tuple[object, ...], int] = {}
    firsts = []
    for number, at in enumerate(wanted):
        around = [view for view, _ in list_window(at, grid)]
        for view in around:
            if view not in kind:
                kind[view] = kinds.setdefault(views[view].tobytes(), len(kinds))
        there = (select_axis(place, count).present.tobytes() for place, count in zip(at, grid, strict=True))
        firsts.append(first.setdefault((*there, *(kind[view] for view in around)), number))
    return firsts


class Differing:
    """Where the views of one tile differ from colours, each looked at once."""

    def __init__(self, views: Mapping[View, Pixels], grid: tuple[int, int], tile: Tile, by: int) -> None:
        """`by`: whole pixels by which a view is moved to match the next, see `models.light_field.disparity`."""
        self._views, self._grid, self._tile, self._by = views, grid, tile, by
        self._known: dict[tuple[View, bytes], NDArray[np.bool_]] = {}

    def boxes(self, at: View, around: Pixels, radius: int, statistics: SkipStatistics) -> list[Tile]:
        """What to compute of view `at` in the tile, all else being one colour, `around`, `(C,)`, for a network that
        sees `radius` far; what isn't is added to `statistics`.
        """
        tile = self._tile
        if skipping.boxes(disparity.moved(self._one(at, around), self._by, (0, 0)), radius) is None:
            return [tile]  # nor is it worth it for more views
        seen = [
            disparity.moved(self._one(view, around), self._by, offset)
            for view, offset in set(list_window(at, self._grid))
        ]
        boxes = skipping.boxes(np.logical_or.reduce(seen), radius)
        if boxes is None:
            return [tile]
        computed = sum(skipping.area(box.window) for box in boxes)
        statistics.uniform += max(0, skipping.area(tile.kept) - computed)
        return [part for part in (box.within(tile) for box in boxes) if skipping.area(part.kept)]

    def _one(self, view: View, around: Pixels) -> NDArray[np.bool_]:
        key = view, around.tobytes()
        if key not in self._known:
            part = disparity.margined(self._views[view], self._tile.window, self._by)
            self._known[key] = skipping.differing(part, around)
        return self._known[key]


def pattern(
    network: LightFieldNetwork, around: Pixels, at: View, grid: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What view `at` becomes where all views are one colour, `(C,)`, as `skipping.fill` takes it: RGB in [0, 1],
    `(scale*(2*radius + 1), ..., 3)`, and the doubt, `(2*radius + 1, ..., 1)`.
    """
    rows, cols = (select_axis(place, count).present.tobytes() for place, count in zip(at, grid, strict=True))
    return _pattern(network, around.tobytes(), around.dtype.name, rows, cols)


@lru_cache(maxsize=256)
def _pattern(
    network: LightFieldNetwork, colour: bytes, dtype: str, rows: bytes, cols: bytes
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    side = 2 * network.radius + 1
    plain: NDArray[Any] = np.tile(np.frombuffer(colour, dtype), (side, side, 1))
    image = np.broadcast_to(disparity.as_float(plain), (side, side, 3)).transpose(2, 0, 1)
    around = np.broadcast_to(disparity.luma(plain), (WINDOW_SIDE * WINDOW_SIDE, side, side))
    there = (np.frombuffer(part, np.float32) for part in (rows, cols))
    pictures = (np.ascontiguousarray(part)[np.newaxis] for part in (image, around))
    large, doubt = network(*pictures, *there, cores=1)  # too small for more to be of use
    return large[0].transpose(1, 2, 0), doubt[0].transpose(1, 2, 0)
