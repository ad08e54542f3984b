"""Finds the parts of a light field's views that can be upscaled without the network.

These are parts where a view and all views of its window are uniform (see `models.single.skipping`), and parts that are
computed with another shift.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.models.light_field.disparities.shifts import crop_luma, crop_with_margin, shift_part
from ciir.models.light_field.pixels import convert_to_planes
from ciir.models.light_field.windows import WINDOW_SIDE, Axis, list_window, select_axis
from ciir.models.single import skipping
from ciir.models.tiles import Tile

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels
    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.light_field.planes import Range
    from ciir.models.light_field.windows import View


def find_background(network: LightFieldNetwork, view: Pixels) -> Pixels | None:
    """Returns the background colour `(C,)` of a view `(H, W, C)`; None if skipping it would save nothing."""
    if min(view.shape[:2]) <= 2 * network.radius or not skipping.can_skip(network):
        return None
    return skipping.find_background(view)


class TileDifferences:
    """The places where the views of one tile differ from their background. Each view is compared once."""

    def __init__(self, views: Mapping[View, Pixels], grid: tuple[int, int], tile: Tile, margin: int) -> None:
        """`margin`: at least `models.light_field.disparities.shifts.find_margin` of every shift."""
        self._views, self._grid, self._tile, self._margin = views, grid, tile, margin
        self._found: dict[tuple[View, bytes], NDArray[np.bool_]] = {}

    def find_boxes(self, view: View, background: Pixels, radius: int, shift: int) -> list[Tile]:
        """Returns the boxes of the tile to compute for a view whose window is `background` `(C,)` elsewhere. `radius`:
        the network's. `shift`: whole pixels by which views are shifted for each step in the grid; see
        `models.light_field.disparities.shifts`.
        """
        tile = self._tile
        own = shift_part(self._find_differences(view, background), shift, (0, 0), self._margin)
        if skipping.cover_with_boxes(own, radius) is None:
            return [tile]  # more views would differ in more places
        window = set(list_window(view, self._grid))
        differs = [
            shift_part(self._find_differences(other, background), shift, offset, self._margin)
            for other, offset in window
        ]
        boxes = skipping.cover_with_boxes(np.logical_or.reduce(differs), radius)
        if boxes is None:
            return [tile]
        return [part for part in (box.clip_to(tile) for box in boxes) if skipping.count_pixels(part.kept)]

    def _find_differences(self, view: View, background: Pixels) -> NDArray[np.bool_]:
        key = view, background.tobytes()
        if key not in self._found:
            part = crop_with_margin(self._views[view], self._tile.region, self._margin)
            self._found[key] = skipping.find_differences(part, background)
        return self._found[key]


def split_by_mask(
    network: LightFieldNetwork, boxes: Sequence[Tile], mask: NDArray[np.bool_], tile: Tile
) -> Iterator[tuple[Tile, NDArray[np.bool_] | None]]:
    """Yields boxes that keep the pixels of `boxes`, parts of `tile`, where `mask` is true. `mask` `(h, w)` covers the
    part that `tile` keeps. Each box comes with its part of the mask, or None if that is true everywhere.
    """
    for box in boxes:
        own = mask[Tile(box.kept, box.kept).region_in(tile.kept)]
        if own.all():
            yield box, None
        elif own.any():
            for part in _split_box(network, box, own):
                yield part, mask[Tile(part.kept, part.kept).region_in(tile.kept)]


def count_skipped(parts: Sequence[Tile], mask: NDArray[np.bool_]) -> int:
    """Returns a lower bound for the number of pixels where `mask` is true that none of the `parts` computes."""
    return max(0, int(np.count_nonzero(mask)) - sum(skipping.count_pixels(part.region) for part in parts))


def _split_box(network: LightFieldNetwork, box: Tile, mask: NDArray[np.bool_]) -> list[Tile]:
    """Returns boxes around the pixels where `mask` `(h, w)`, which covers the part that `box` keeps, is true; `box`
    itself if they save nothing.
    """
    if not skipping.can_skip(network):
        return [box]
    parts = []
    for kept in skipping.split_differences(mask, network.radius, (box.kept[0].start, box.kept[1].start)):
        rows, cols = (
            slice(max(around.start, side.start - network.radius), min(around.stop, side.stop + network.radius))
            for side, around in zip(kept, box.region, strict=True)
        )
        parts.append(Tile((rows, cols), kept))
    return (
        parts
        if sum(skipping.count_pixels(part.region) for part in parts) < skipping.count_pixels(box.region)
        else [box]
    )


def make_pattern(
    network: LightFieldNetwork, background: Pixels, view: View, grid: tuple[int, int], disparities: Range
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns the network's result for `view` if all views are one colour `(C,)`, as `skipping.fill_with_pattern` takes
    it: RGB in [0, 1], `(scale*(2*radius + 1), ..., 3)`, and the uncertainty, `(2*radius + 1, ..., 1)`. `disparities`:
    the range of the rest of the view.
    """
    rows, cols = (select_axis(place, count).present.tobytes() for place, count in zip(view, grid, strict=True))
    return _make_pattern(network, background.tobytes(), background.dtype.name, (rows, cols), disparities)


@lru_cache(maxsize=256)
def _make_pattern(
    network: LightFieldNetwork, colour: bytes, dtype: str, window: tuple[bytes, bytes], disparities: Range
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    side = 2 * network.radius + 1
    uniform: NDArray[Any] = np.tile(np.frombuffer(colour, dtype), (side, side, 1))
    image = convert_to_planes(uniform)
    around = np.broadcast_to(crop_luma(uniform), (WINDOW_SIDE * WINDOW_SIDE, side, side))
    rows, cols = (Axis(tuple(range(WINDOW_SIDE)), np.frombuffer(present, np.float32)) for present in window)
    image, around = (np.ascontiguousarray(part)[np.newaxis] for part in (image, around))
    large, uncertainty = network(image, around, rows, cols, disparities, cores=0)
    return large[0].transpose(1, 2, 0), uncertainty[0].transpose(1, 2, 0)
